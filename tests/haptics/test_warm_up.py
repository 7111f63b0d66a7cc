"""What haptics asks for while it runs was compiled before."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.haptics.test_grasps import ACROSS_RAD, CLOSING_TICKS, FAR, OPEN_RAD, round_catheter
from tests.kernels.signatures import compiled_signatures
from tests.physics.conftest import SMALL, Rig, let_time_pass
from trocar.protocol import Frame
from trocar.services.files.cache_directory import cache_directory
from trocar.services.haptics.warm_up import warm_up
from trocar.services.scenes import load_duct, load_scene


@pytest.mark.timeout(600)  # on a machine that has compiled nothing yet
def test_nothing_is_compiled_while_jaws_close_on_catheter_and_wall() -> None:
    command, root = [sys.executable, "-m", "tests.haptics.test_warm_up"], Path(__file__).parents[2]
    run = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout.splitlines()[-1]) == {"compiled": [], "holds": True}


def _run() -> None:
    """Print what haptics compiles after its warm-up, and whether jaws have held anything."""
    scene = load_scene(SMALL, [])
    warm_up(scene, load_duct(scene, cache_directory(), lambda stage, fraction: None))
    let_time_pass(pytest.MonkeyPatch())
    rig, compiled, holds = Rig(), set[str](), False
    answer = rig.haptics.answer

    def watched(frame: Frame) -> None:
        before = compiled_signatures()
        answer(frame)
        compiled.update(compiled_signatures() - before)

    rig.haptics.answer = watched  # type: ignore[method-assign]
    spy, junction = type(rig.gateway)(rig.hub, reads=["haptics.contacts"]), round_catheter(rig)
    for at in (junction, (0.02, 0.0, 0.006)):
        for k in range(CLOSING_TICKS + 40):
            handle_rad = OPEN_RAD * max(0.0, 1.0 - k / CLOSING_TICKS)
            rig.turn(at, FAR, handle_rad=handle_rad, roll_rad=ACROSS_RAD)
            frame = spy.latest("haptics.contacts")
            holds |= frame is not None and bool(frame.body.holds)
    print(json.dumps({"compiled": sorted(compiled), "holds": holds}))


if __name__ == "__main__":
    _run()
