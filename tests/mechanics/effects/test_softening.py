"""A scene whose wall softens: it gives way to a tool, its energy books balance, and it rests when it is let go."""

import numpy as np
import pytest
from effect_runs import PRESSED_M, come_down

from trocar.services.mechanics.bodies.wall_terms import terms_of
from trocar.services.mechanics.reduction.softened_wall.load_pattern import GAIN
from trocar.services.mechanics.reduction.wall_step.implicit_step import CREDIT_J
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.studies.energy_book import EnergyBook

pytestmark = pytest.mark.timeout(600)


@pytest.fixture
def scene(with_effects):
    return with_effects(softening={"n_squeezes": 8})


@pytest.fixture
def duct(scene, cache_dir):
    return build_scene_duct(scene, cache_dir)


def pressed(scene, duct, ticks=400):
    simulation, top = Simulation(scene, duct), PRESSED_M[2]
    tools = come_down(simulation)
    for tick in range(ticks):
        tools.position_m[0, 2] = top - 3.0e-3 * min(1.0, tick / (0.6 * ticks))
        simulation.step(tools)
    return simulation, tools


def test_a_tool_meets_less_force(scene, duct, with_effects):
    """Pressed in by a third of its width the wall pushes back less than a linear one, and more than half as much."""
    soft, _ = pressed(scene, duct)
    stiff, _ = pressed(with_effects(), duct)
    force, linear = (np.linalg.norm(run.tool_results.force_n[0]) for run in (soft, stiff))
    assert 0.5 * linear < force < 0.95 * linear


@pytest.mark.parametrize("others", [{}, {"viscoelasticity": {}}])
def test_the_books_balance(with_effects, duct, others):
    scene = with_effects(softening={"n_squeezes": 8}, **others)
    simulation, tools = Simulation(scene, duct), ToolInputs()
    tools.present[1] = False
    tools.position_m[0] = np.add(PRESSED_M, (0.0, 0.0, 4e-3))
    simulation.step(tools)
    book, top, largest = EnergyBook(simulation), tools.position_m[0, 2], 0.0
    for tick in range(1200):
        tools.position_m[0, 2] = top - 7.0e-3 * max(0.0, 1.0 - abs(tick / 600.0 - 1.0))
        book.step(tools)
        largest = max(largest, book.flow.input_j)
    assert abs(book.flow.imbalance_j) < 0.01 * largest
    assert 0.0 <= book.flow.effects_j < (0.5 if others else 0.05) * largest


def test_what_is_let_go_rests(scene, duct):
    """What is left is what the tank owes: a wall that springs back goes further in a step than its rates foretold."""
    simulation, tools = pressed(scene, duct)
    effect = simulation.effects["softening"]
    stored_j = effect.potential_energy_j(simulation.world)
    assert stored_j < 0.0
    tools.present[:] = False
    for _ in range(300):
        simulation.step(tools)
    assert abs(effect.potential_energy_j(simulation.world)) <= 1e-3 * abs(stored_j) + 2.0 * CREDIT_J
    terms = terms_of(simulation.duct)
    assert not effect.state_arrays()[0].any()
    assert not terms.softened.at_sites.any()
    assert terms.step.pattern.numbers[GAIN] == 0.0, "no pattern is left that each tick would have to look at"


def test_an_absent_hand_meets_nothing(scene, duct):
    simulation, tools = Simulation(scene, duct), ToolInputs()
    tools.present[:] = False
    for _ in range(50):
        simulation.step(tools)
    assert not simulation.effects["softening"].state_arrays()[0].any()
