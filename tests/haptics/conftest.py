"""The rig in memory, as physics is tested with it."""

from tests.physics.conftest import in_memory as in_memory
from tests.physics.conftest import rig as rig
