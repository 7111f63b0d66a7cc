"""Effects that fade where a rung of the quality ladder lets them rest: nothing jumps, and the books balance."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from effect_runs import PRESSED_M, come_down

from tests.by_day import by_day
from trocar.services.mechanics.scene import QualityLevel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.mechanics.snapshot import Snapshot
from trocar.services.scenes import build_scene
from trocar.studies.energy_book import EnergyBook

pytestmark = pytest.mark.timeout(600)
SOFT, STIFF = {"softening": {"n_squeezes": 8}}, {"hyperelasticity": {"exponent": 400.0}}
VISCOUS = {"viscoelasticity": {"g": [0.3], "tau_s": [0.1]}}
KINDS = {"softening": SOFT, "softening that lags": SOFT | VISCOUS, "hyperelasticity": STIFF, "both": SOFT | STIFF}
FADES = "softening", "hyperelasticity"
DEPTH_M = 2.5e-3
# Beside the top: on the edge there the tool rests, or on either side, by chance.
AT_M = PRESSED_M[0], 1e-3, PRESSED_M[2]
LARGEST_CHANGE_N = 0.02  # a millisecond: a tenth of what a rig lets the force at a hand change by


@pytest.fixture(scope="module", params=by_day(["both", "softening that lags"], ["softening", "hyperelasticity"]))
def scene(request, small_scene):
    effects = build_scene({"effects": KINDS[request.param]}, "scene.yaml").effects
    without = tuple(name for name in effects if name in FADES)
    return replace(small_scene, effects=effects, quality=(QualityLevel(), QualityLevel(name="less", without=without)))


@pytest.fixture(scope="module")
def duct(scene, cache_dir):
    return build_scene_duct(scene, cache_dir)


@pytest.fixture(scope="module")
def beginning(scene, duct):
    """A tool pressed into the wall, and its beginning there."""
    simulation = Simulation(scene, duct)
    tools = pressed(simulation)
    return simulation, tools, Snapshot(simulation, (scene, simulation.scene, duct, simulation.duct.reduced))


@pytest.fixture
def press(beginning):
    simulation, tools, snapshot = beginning
    snapshot.restore()
    return simulation, deepcopy(tools)


def pressed(stepped):
    """Press a tool into the wall of a simulation, or of that of a book; return the tools as they are then."""
    tools, top = ToolInputs(), AT_M[2] + 4e-3
    tools.present[1] = False
    tools.position_m[0] = *AT_M[:2], top
    for height_m in (*(top - 4e-5 * np.arange(101)), *(AT_M[2] - DEPTH_M * np.minimum(1.0, np.arange(600) / 300.0))):
        tools.position_m[0, 2] = height_m
        stepped.step(tools)
    return tools


def felt(simulation):
    return simulation.tool_results.force_n[0].copy()


def go_on(simulation, tools, ticks, largest_change_n=np.inf):
    """Take steps with the hand held still; no step changes the force by more than is said."""
    before = felt(simulation)
    for _ in range(ticks):
        simulation.step(tools)
        now = felt(simulation)
        assert np.linalg.norm(now - before) < largest_change_n
        before = now
    return before


def test_the_force_goes_smoothly_to_that_without_the_effect_and_back(press, scene, duct):
    """Its size is compared, from the second time on: the first one shakes the tool off the edge that it came to."""
    kept = {name: settings for name, settings in scene.effects.items() if name not in FADES}
    absent = Simulation(replace(scene, effects=kept, quality=scene.quality[:1]), duct)
    without = go_on(absent, pressed(absent), 900)
    simulation, tools = press
    forces = []
    for level in (1, 0, 1, 0):
        simulation.set_quality(level)
        forces.append(np.linalg.norm(go_on(simulation, tools, 600, LARGEST_CHANGE_N)))
    _, with_it, resting, again = forces
    without = np.linalg.norm(without)
    near = 0.03 * abs(without - with_it) + 0.01 * with_it
    assert resting == pytest.approx(without, abs=near)
    assert again == pytest.approx(with_it, abs=near)


def test_no_stage_of_an_effect_that_has_faded_is_called(press, monkeypatch):
    simulation, tools = press
    called = []
    for name in FADES:
        if name in simulation.effects:
            effect = simulation.effects[name]
            monkeypatch.setattr(
                effect, "add_loads", lambda world, dt_s, act=effect.add_loads: called.append(act(world, dt_s))
            )
    simulation.set_quality(1)
    go_on(simulation, tools, 200)
    assert called
    go_on(simulation, tools, 60)
    called.clear()
    go_on(simulation, tools, 20)
    assert not called


def test_the_books_balance_whatever_comes_and_goes(scene, duct):
    """Every 3 ticks, every 40 and every 400: each rhythm begins where the one before has led."""
    book = EnergyBook(Simulation(scene, duct))
    tools = pressed(book)
    for every, ticks in ((3, 400), (40, 400), (400, 800)):
        for tick in range(ticks):
            book.simulation.set_quality(tick // every % 2)
            book.step(tools)
        assert abs(book.flow.imbalance_j) < 0.01 * book.flow.input_j
        assert np.linalg.norm(felt(book.simulation)) < 10.0


def test_a_scene_may_begin_on_a_rung_on_which_it_rests(scene, duct):
    lowest = Simulation(replace(scene, quality=scene.quality[1:]), duct)
    assert not any(lowest.effects[name].rests for name in lowest.rung.without)
    tools = come_down(lowest)
    for _ in range(300):
        lowest.step(tools)
    assert all(lowest.effects[name].rests for name in lowest.rung.without)


def test_what_comes_back_is_not_taken_for_a_gain_of_the_step(press, monkeypatch):
    """A tool that stands still: what the potential grows by is owed by no rate."""
    simulation, tools = press
    simulation.set_quality(1)
    go_on(simulation, tools, 600)
    taken = []
    monkeypatch.setattr(simulation.duct, "remove_energy", lambda energy_j: taken.append(energy_j) or energy_j)
    simulation.set_quality(0)
    go_on(simulation, tools, 400)
    assert sum(taken) <= 1e-7
