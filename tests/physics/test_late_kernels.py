"""No kernel is compiled, or read from disk, once a loop runs: in any scene, while its own hands play."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from services.cache_directory import cache_directory
from services.mechanics.compiled import KERNELS
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation
from services.mechanics.simulation.scene_catheter import place_catheter
from services.physics.warm_up import warm_up, warm_up_contact
from services.runtime.config import config_directory
from services.scenes import load_duct, load_scene
from services.scenes.hands import hands_of
from services.scenes.ready import load_surface

#: What no step of physics calls: the hands' motion is the gateway's, what jaws have taken is found by haptics.
OF_OTHERS = ("minimum_jerk", "find_deepest_touch", "find_touched_apart")
TICKS = 1500
#: Smaller ducts: what is compiled does not depend on their size.
SMALL = ["duct.n_around=12", "duct.n_along=16", "duct.n_modes=24"]
BY_DAY = ("everything", "stone")
NEEDS = {"anatomy": "a surface that is not in the repository", "duct-only": "a loop of its own"}
SCENES = sorted(path.stem for path in (config_directory() / "scenes").glob("*.yaml") if path.stem not in NEEDS)


@pytest.mark.timeout(600)  # on a machine that has compiled nothing yet
@pytest.mark.parametrize("scene", [pytest.param(s, marks=() if s in BY_DAY else pytest.mark.long) for s in SCENES])
def test_nothing_is_compiled_while_a_scenes_hands_play(scene: str) -> None:
    command, root = [sys.executable, "-m", "tests.physics.test_late_kernels", scene], Path(__file__).parents[2]
    run = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout.splitlines()[-1]) == []


def _signatures() -> set[str]:
    named = {each.py_func.__qualname__: each for each in KERNELS if each.py_func.__qualname__ not in OF_OTHERS}
    return {f"{name} {types}" for name, each in named.items() for types in each.signatures}


def _play(name: str) -> None:
    """Print what physics compiles after its warm-up."""
    scene = load_scene(name, SMALL)
    mesh = load_surface(scene, cache_directory())
    duct = load_duct(scene, cache_directory(), lambda stage, fraction: None)
    warm_up_contact(scene)
    warm_up(scene, duct)
    before = _signatures()
    hands = hands_of(place_catheter(scene, mesh), mesh)
    simulation, tools = Simulation(scene, duct), ToolInputs()
    for tick in range(TICKS):
        hands.write_inputs(hands.duration_s * tick / TICKS, tools)
        simulation.step(tools)
    print(json.dumps(sorted(_signatures() - before)))


if __name__ == "__main__":
    _play(sys.argv[1])
