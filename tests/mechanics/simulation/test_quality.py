from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.collision.pieces import N_TOOL_PIECES
from trocar.services.mechanics.scene import QualityLevel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation


@pytest.fixture
def ladder(with_effects, small_duct):
    """A tool pressed on the duct and at rest, two rungs of quality."""
    levels = (QualityLevel(), QualityLevel(name="low", iterations=1))
    simulation = Simulation(replace(with_effects(friction={}), quality=levels), small_duct)
    tools = ToolInputs()
    tools.present[1] = False
    for tick in range(300):
        tools.position_m[0] = 20e-3, 0.0, 15e-3 + 3.5e-3 + 3e-5 * max(100 - tick, 0)
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
    assert largest < 0.2  # what the rig lets the force at a hand change in a millisecond


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


def _falls(simulation, ticks, level=0):
    """Let the catheter fall on the wall and be pulled back by its seal's friction, without hands."""
    tools = ToolInputs()
    tools.present[:] = False
    simulation.set_quality(level)
    for _ in range(ticks):
        simulation.step(tools)


@pytest.fixture
def resting_scene(with_effects):
    """A catheter that falls on the wall of a duct wet with mucus, which rests on the second rung."""
    scene = with_effects(gravity={}, mucus_drag={}, self_contact={})
    rung = QualityLevel(name="dry", without=("mucus_drag", "self_contact"))
    return replace(scene, quality=(QualityLevel(), rung))


def test_an_effect_that_rests_on_a_rung_is_as_if_it_were_not_there(resting_scene, small_duct):
    rests, acts = Simulation(resting_scene, small_duct), Simulation(resting_scene, small_duct)
    gravity = {"gravity": resting_scene.effects["gravity"]}
    absent = Simulation(replace(resting_scene, effects=gravity, quality=(QualityLevel(),)), small_duct)
    for simulation, level in ((rests, 1), (acts, 0), (absent, 0)):
        _falls(simulation, 120, level)
    assert np.array_equal(rests.catheter.state.position_m, absent.catheter.state.position_m)
    assert np.array_equal(rests.duct.state.q, absent.duct.state.q)
    assert not np.array_equal(acts.catheter.state.position_m, absent.catheter.state.position_m)


def test_an_effect_that_comes_back_moves_nothing_by_itself(resting_scene, small_duct):
    simulation = Simulation(resting_scene, small_duct)
    _falls(simulation, 120, 1)
    speed_m_s = np.abs(simulation.catheter.state.velocity_m_s).max()
    _falls(simulation, 1, 0)
    assert np.abs(simulation.catheter.state.velocity_m_s).max() <= 1.05 * speed_m_s + 1e-4


def test_strands_that_crossed_while_self_contact_rested_are_told_apart_anew(resting_scene, small_duct):
    simulation = Simulation(resting_scene, small_duct)
    memory = simulation.search._arrays.capsules
    strands = memory.active[N_TOOL_PIECES:]
    strands[0, 9] = 1
    simulation.set_quality(1)
    simulation.step(ToolInputs())
    assert not strands.any()
    simulation.set_quality(0)
    assert not strands.any()


class Parts:
    """Counts the parts that steps are taken in."""

    def __init__(self):
        self.lengths_s = []

    def begin(self):
        pass

    def end(self, dt_s):
        self.lengths_s.append(dt_s)


@pytest.fixture
def long_steps(with_effects, small_duct):
    """A tool pressed on the duct and at rest; on the second rung steps may be of 2 ms."""
    levels = (QualityLevel(), QualityLevel(name="long steps", ticks_per_step=2))
    simulation = Simulation(replace(with_effects(friction={}), quality=levels), small_duct)
    tools = ToolInputs()
    tools.present[1] = False
    for tick in range(400):
        tools.position_m[0] = 20e-3, 0.0, 15e-3 + 3.5e-3 + 3e-5 * max(100 - tick, 0)
        simulation.step(tools)
    simulation.watcher = Parts()
    return simulation, tools


def test_steps_are_longer_on_a_rung_that_says_so_and_only_there(long_steps):
    simulation, tools = long_steps
    for level, lengths_s in ((0, [1e-3, 1e-3]), (1, [2e-3])):
        simulation.watcher.lengths_s.clear()
        simulation.set_quality(level)
        simulation.step(tools, 2e-3)
        assert simulation.watcher.lengths_s == pytest.approx(lengths_s)


def test_switching_to_longer_steps_and_back_moves_nothing(long_steps):
    """What is pressed at rest stays: a step's length says how far a lasting force swings the rates within it."""
    simulation, tools = long_steps
    force_n, q = simulation.tool_results.force_n[0].copy(), simulation.duct.state.q.copy()
    assert np.linalg.norm(force_n) > 0.03
    for tick in range(60):
        level = tick // 3 % 2
        simulation.set_quality(level)
        simulation.step(tools, (1 + level) * 1e-3)
        assert simulation.tool_results.force_n[0] == pytest.approx(force_n, abs=0.01 * np.linalg.norm(force_n))
    assert np.abs(simulation.duct.state.q - q).max() < 0.01 * np.abs(q).max()


@pytest.mark.parametrize(("speed_m_s", "parts"), [(0.4, 1), (0.6, 2), (1.9, 2)])
def test_a_long_step_is_taken_in_parts_where_something_is_fast(long_steps, speed_m_s, parts):
    """A step of a millisecond is not, up to two metres a second."""
    simulation, tools = long_steps
    tools.present[:] = False
    simulation.set_quality(1)
    for _ in range(400):  # until the wall has come back
        simulation.step(tools)
    for dt_s, expected in ((1e-3, 1), (2e-3, parts)):
        simulation.catheter.state.velocity_m_s[:] = speed_m_s, 0.0, 0.0
        simulation.watcher.lengths_s.clear()
        simulation.step(tools, dt_s)
        assert len(simulation.watcher.lengths_s) == expected


@pytest.mark.parametrize(
    ("without", "essential", "said"),
    [
        (("gravity",), (), "quality.1.without: gravity cannot rest while the scene runs; these can: softening, hyp"),
        (("twist",), (), "quality.1.without: the scene has no effect 'twist'"),
        (("mucus_drag",), ("mucus_drag",), "quality.1.without: mucus_drag is essential"),
        ((), ("twist",), "essential: the scene has no effect 'twist'"),
    ],
)
def test_a_ladder_that_cannot_be_is_refused(resting_scene, small_duct, without, essential, said):
    ladder = (QualityLevel(), QualityLevel(name="dry", without=without))
    with pytest.raises(ValueError, match=said):
        Simulation(replace(resting_scene, quality=ladder, essential=essential), small_duct)
