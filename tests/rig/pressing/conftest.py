"""One rig for all tests of this folder: its left hand presses on the duct. The last but one kills its supervisor.

Its processes are the rig's own until they are told to misbehave (`benchmarks/faulty_rig.py`).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.other_user import folder_of_everybody
from tests.rig.conftest import HERE, SCENE, Rig, running_rig
from tests.rig.faults import HARD

#: How long the gateway waits for a word of its supervisor: far longer than it is kept from one, on any machine.
TIMEOUT_S = 2.0
FAULTY = Path(__file__).resolve().parents[3] / "benchmarks" / "faulty_rig.py"


@pytest.fixture(scope="package")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """Return the rig, in a folder that others may enter: what they may not is for the rig itself to refuse."""
    hands = {"script": str(HERE / "press.yaml"), "pace": 2.0}
    overrides = [f"gateway.instruments.{i}.arm.settings.{key}={value}" for i in (0, 1) for key, value in hands.items()]
    overrides += [*HARD, f"gateway.supervisor_timeout_s={TIMEOUT_S}"]
    with folder_of_everybody() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("FAULTY_BEGAN", str(tmp_path_factory.mktemp("faulty") / "began"))
        with running_rig(folder, str(SCENE), overrides, program=(str(FAULTY),)) as rig:
            yield rig
