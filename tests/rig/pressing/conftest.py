"""One rig for all tests of this folder: its left hand presses on the duct. The last of them kills its supervisor."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.other_user import folder_of_everybody
from tests.rig.conftest import HERE, SCENE, Rig, running_rig

#: How long the gateway waits for a word of its supervisor: far longer than it is kept from one, on any machine.
TIMEOUT_S = 10.0


@pytest.fixture(scope="package")
def rig() -> Iterator[Rig]:
    """Return the rig, in a folder that others may enter: what they may not is for the rig itself to refuse."""
    overrides = [f"gateway.instruments.{i}.arm.settings.script={HERE / 'press.yaml'}" for i in (0, 1)]
    overrides.append(f"gateway.supervisor_timeout_s={TIMEOUT_S}")
    with folder_of_everybody() as folder, running_rig(folder, str(SCENE), overrides) as rig:
        yield rig
