"""Whatever a scene may name can be compiled before the loop begins."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.kernels.preloaded import Preloaded
from tests.kernels.signatures import compiled_signatures
from tests.mechanics.compiled.test_allocation import allocating
from tests.physics.conftest import SMALL
from trocar.services.files.cache_directory import cache_directory
from trocar.services.haptics.warm_up import compile_for_physics
from trocar.services.mechanics.collision.pairs import DUCT_TRIANGLE
from trocar.services.mechanics.compiled import KERNELS
from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.physics.stand_in import stand_in_scene
from trocar.services.physics.warm_up import answer_contacts, warm_up, warm_up_contact
from trocar.services.runtime.config.config import config_directory
from trocar.services.scenes import load_duct, load_scene

pytestmark = pytest.mark.timeout(600)  # on a machine that has compiled nothing yet


@pytest.fixture(scope="module")
def preloaded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Preloaded]:
    with Preloaded(tmp_path_factory.mktemp("warm"), "import tests.physics.test_warm_up") as made:
        yield made


def test_a_scene_with_every_effect_warms_up() -> None:
    """Before collision detection is compiled there is none: no effect may insist on it."""
    small = ("effects.nonlinear_membrane.n_coordinates=2", "effects.softening.n_squeezes=2")
    scene = load_scene(SMALL, [*(f"effects.{name}={{}}" for name in EFFECTS), *small])
    assert len(scene.effects) == len(EFFECTS)
    warm_up_contact(scene)
    warm_up(scene, load_duct(scene, cache_directory(), lambda stage, fraction: None))


@pytest.mark.parametrize("path", sorted((config_directory() / "scenes").glob("*.yaml")), ids=lambda path: path.stem)
def test_contacts_are_compiled_for_any_scene_before_there_is_a_duct(path: Path) -> None:
    warm_up_contact(load_scene(path, []))


def test_what_is_compiled_on_the_stand_in_is_what_the_duct_of_the_scene_asks_for(preloaded: Preloaded) -> None:
    """Else it would be compiled in vain, and what is needed later, when everybody waits for it."""
    on_stand_in, added = _run("_compare", preloaded)
    assert on_stand_in > 20
    assert added == []


def test_what_haptics_compiles_for_physics_is_what_physics_asks_for(preloaded: Preloaded) -> None:
    """Else it would be compiled in vain, while the gateway waits for it."""
    asked = set(_run("_physics", preloaded))  # first: what is compiled, not loaded, lists what it calls too
    shared = set(_run("_share", preloaded))
    assert len(shared) > 5
    assert shared - asked == set()


def test_nothing_is_compiled_once_the_loop_runs_and_no_kernel_allocates(preloaded: Preloaded) -> None:
    """Jaws that take hold of the wall stalled physics for 29 ms with a warm cache.

    Closures of one name, compiled by two processes, could be taken for one another by a third.
    """
    assert _run("_later", preloaded) == {"compiled": [], "allocating": [], "closures": []}


def test_nothing_is_compiled_once_a_drive_twists_and_steers(preloaded: Preloaded) -> None:
    assert _run("_driven", preloaded) == []


def _run(what: str, preloaded: Preloaded) -> Any:
    """Return what a function of this module prints in a process in which nothing has been compiled."""
    code = f"from tests.physics import test_warm_up as test; test.{what}()"
    run = preloaded.start(code, (), Path(__file__).parents[2], os.environ).wait()
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout.splitlines()[-1])


def _compare() -> None:
    """Print how many kernels the stand-in asks for, and what the same on the scene's own duct asks for beside them."""
    scene = load_scene(SMALL, [])
    duct = load_duct(scene, cache_directory(), lambda stage, fraction: None)
    before = compiled_signatures()
    warm_up_contact(scene)
    on_stand_in = compiled_signatures()
    answer_contacts(stand_in_scene(scene), duct)
    print(json.dumps([len(on_stand_in - before), sorted(compiled_signatures() - on_stand_in)]))


def _share() -> None:
    """Print what haptics compiles for physics."""
    scene = load_scene(SMALL, [])
    duct = load_duct(scene, cache_directory(), lambda stage, fraction: None)
    before = compiled_signatures()
    compile_for_physics(scene, duct)
    print(json.dumps(sorted(compiled_signatures() - before)))


def _physics() -> None:
    """Print what physics compiles."""
    scene = load_scene(SMALL, [])
    before = compiled_signatures()
    warm_up_contact(scene)
    warm_up(scene, load_duct(scene, cache_directory(), lambda stage, fraction: None))
    print(json.dumps(sorted(compiled_signatures() - before)))


def _later() -> None:
    """Print what strokes across duct and catheter, with a hold on the wall, compile after the warm-up."""
    scene = load_scene(SMALL, [])
    duct = load_duct(scene, cache_directory(), lambda stage, fraction: None)
    warm_up_contact(scene)
    warm_up(scene, duct)
    before = compiled_signatures()
    simulation, tools = Simulation(scene, duct), ToolInputs()
    particles_m = simulation.catheter.state.position_m
    beside_m = particles_m[len(particles_m) // 2].copy()
    for tick in range(400):
        tools.position_m[0] = 20e-3, 0.0, 20e-3 + 8e-3 * np.sin(tick / 15)
        tools.position_m[1] = (*beside_m[:2], beside_m[2] + 12e-3 * np.sin(tick / 9))
        tools.jaw_angle_rad[:] = 0.6 + 0.6 * np.sin(tick / 20)
        is_held = 200 < tick < 300
        tools.holds = [GraspHold(1, 1, DUCT_TRIANGLE, 10, np.array([0.5, 0.3, 0.2]), 1.0, 0.2)] if is_held else []
        simulation.step(tools)
    assert simulation.solver.pricing.new_rows
    compiled = sorted(compiled_signatures() - before)
    closures = [each.py_func.__qualname__ for each in KERNELS if "<locals>" in each.py_func.__qualname__]
    print(json.dumps({"compiled": compiled, "allocating": allocating(KERNELS), "closures": closures}))


def _driven() -> None:
    """Print what a drive compiles after the warm-up that pushes, twists and steers a catheter."""
    section = "catheter.sections=[{length_m: 0.02, steering_1_m_rad: [50.0, 0.0, 0.0]}]"
    scene = load_scene(SMALL, ["forceps=[{kind: drive}]", "hands=none", "effects.twist={}", section])
    duct = load_duct(scene, cache_directory(), lambda stage, fraction: None)
    warm_up_contact(scene)
    warm_up(scene, duct)
    before = compiled_signatures()
    simulation, tools = Simulation(scene, duct), ToolInputs()
    end_m = simulation.catheter.state.position_m[0].copy()
    for tick in range(200):
        tools.position_m[0] = end_m - (1e-5 * tick, 0.0, 0.0)
        tools.roll_rad[0], tools.jaw_angle_rad[0] = 5e-3 * tick, 4e-3 * tick
        simulation.step(tools)
    assert simulation.drive is not None
    assert simulation.drive.work_j > 0.0
    print(json.dumps(sorted(compiled_signatures() - before)))
