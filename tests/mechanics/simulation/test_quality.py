from dataclasses import replace

import numpy as np
import pytest

from services.mechanics.scene import QualityLevel
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation


@pytest.fixture
def ladder(with_effects, small_duct):
    """A tool pressed on the duct and at rest, two rungs of quality."""
    levels = (QualityLevel(), QualityLevel(name="low", iterations=1))
    simulation = Simulation(replace(with_effects(friction={}), quality=levels), small_duct)
    tools = ToolInputs()
    tools.present[1] = False
    tools.position_m[0] = 20e-3, 0.0, 15e-3 + 4.5e-3
    for _ in range(300):
        simulation.step(tools)
    return simulation, tools


def test_switching_quality_moves_nothing_by_itself(ladder):
    simulation, tools = ladder
    before = simulation.duct.state.q.copy(), simulation.catheter.state.position_m.copy()
    simulation.set_quality(1)
    assert np.array_equal(before[0], simulation.duct.state.q)
    assert np.array_equal(before[1], simulation.catheter.state.position_m)
    force = simulation.tool_results.force_n[0].copy()
    largest = 0.0
    for _ in range(50):
        simulation.step(tools)
        largest = max(largest, np.linalg.norm(simulation.tool_results.force_n[0] - force))
        force[:] = simulation.tool_results.force_n[0]
    assert largest < 0.3


def test_a_lower_rung_makes_fewer_sweeps_and_the_wall_stays_what_it_is(ladder):
    """Contacts on part of the modes were solved for a wall that then gave way more: 434 N at a switch every tick."""
    simulation, tools = ladder
    simulation.step(tools)
    sweeps, stiffness_n_m = simulation.system.sweeps, simulation.tool_results.stiffness_n_m[0, 2, 2]
    simulation.set_quality(1)
    simulation.step(tools)
    assert simulation.system.sweeps == 1 < sweeps
    assert simulation.tool_results.stiffness_n_m[0, 2, 2] == pytest.approx(stiffness_n_m, rel=1e-3)


def test_switching_in_every_tick_moves_nothing(ladder):
    simulation, tools = ladder
    start_n = simulation.tool_results.force_n[0].copy()
    for tick in range(100):
        simulation.set_quality(tick % 2)
        simulation.step(tools)
        assert np.linalg.norm(simulation.tool_results.force_n[0] - start_n) < 0.02 * np.linalg.norm(start_n)


def test_a_level_that_does_not_exist_is_refused(ladder):
    with pytest.raises(ValueError, match="quality level 2 is not within 0 and 1"):
        ladder[0].set_quality(2)
