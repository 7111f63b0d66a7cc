"""Impossible states: no motion ends in one, and one that a caller has set is put back, at rest."""

import numpy as np
import pytest

from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.healing import MOST_STRETCH
from trocar.studies.energy_book import EnergyBook

PRESSING_M = (20e-3, 0.0, 15e-3 + 1.5e-3)
AWAY_M = (60e-3, 0.0, 60e-3)


def too_fast_m_s(simulation):
    """Twice what the largest strain, let go, makes of it."""
    return 2.0 * MOST_STRETCH * simulation.catheter.properties.sound_m_s()


class Spoiler:
    """Shoots the catheter at the end of each part of a step in which something is so."""

    def __init__(self, simulation, is_bad):
        self.simulation, self.is_bad = simulation, is_bad
        simulation.watcher = self

    def begin(self):
        pass

    def end(self, dt_s):
        if self.is_bad(self.simulation):
            self.simulation.catheter.state.velocity_m_s[-1, 2] = too_fast_m_s(self.simulation)


def state(simulation):
    return np.concatenate([simulation.duct.state.q, simulation.catheter.state.position_m.ravel()])


@pytest.fixture
def pressed(small_scene, small_duct):
    """Tool 0 presses the wall from above; with the state after the first step."""
    simulation, tools = Simulation(small_scene, small_duct), ToolInputs()
    first = None
    for tick in range(150):
        tools.position_m[:] = np.add(PRESSING_M, (0.0, 0.0, max(4.2e-3 - tick * 3e-5, 0.0))), AWAY_M
        simulation.step(tools)
        first = state(simulation) if first is None else first
    assert np.linalg.norm(simulation.tool_results.force_n[0]) > 0.05
    return simulation, tools, first


@pytest.mark.parametrize("reaches_halves", [True, False])
def test_a_motion_to_an_impossible_state_does_not_happen(pressed, monkeypatch, reaches_halves):
    """Whatever a solve comes to: the time is withheld, nothing moves, and what is felt is what was felt before."""
    simulation, tools, _ = pressed
    was, felt_n = state(simulation), simulation.tool_results.force_n.copy()
    solve, shortest_s = simulation.solver.solve, 0.25e-3

    def shoot(dt_s):
        is_settled = solve(dt_s)
        if not reaches_halves or dt_s > shortest_s:
            simulation.catheter.state.velocity_m_s[-1, 2] = too_fast_m_s(simulation)
        return is_settled

    monkeypatch.setattr(simulation.solver, "solve", shoot)
    for _ in range(3):
        tools.position_m[0, 0] += 10e-6
        simulation.step(tools)
    assert simulation.healed_states == 0
    if reaches_halves:
        assert simulation.withheld_s == 0.0
        assert np.abs(state(simulation) - was).max() > 1e-9
    else:
        assert simulation.withheld_s == pytest.approx(3e-3)
        assert np.array_equal(state(simulation), was)
        assert not simulation.catheter.state.velocity_m_s.any()
        assert np.array_equal(simulation.tool_results.force_n, felt_n)


def test_a_caller_that_spoils_every_state_never_sees_one_kept(pressed):
    simulation, tools, _ = pressed
    was = state(simulation)
    Spoiler(simulation, lambda _: True)
    for tick in range(6):
        simulation.step(tools)
        assert simulation.healed_states == (tick + 1) // 2
        if tick % 2:
            assert np.abs(state(simulation) - was).max() < 1e-3
            assert not simulation.catheter.state.velocity_m_s.any()
            assert not simulation.tool_results.force_n.any()


def test_a_state_that_a_caller_has_torn_is_replaced_by_the_start_of_the_last_step(pressed):
    simulation, tools, first = pressed
    line_m = simulation.catheter.state.position_m
    whole_m = line_m.copy()
    line_m[-10:, 0] += 30e-3
    simulation.step(tools)
    assert simulation.healed_states == 1
    assert np.abs(line_m - whole_m).max() < 3e-3
    assert np.abs(state(simulation) - first).max() > 1e-5, "it is not the first state"


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_scene_does_not_begin_with_what_is_no_number(small_scene, small_duct, value):
    simulation, tools = Simulation(small_scene, small_duct), ToolInputs()
    simulation.catheter.state.position_m[3, 1] = value
    with pytest.raises(ValueError, match="holds a NaN or an infinity before the first step"):
        simulation.step(tools)
    simulation.catheter.state.position_m[3, 1] = 0.0
    simulation.step(tools)


def let_go(simulation, tools):
    """Withdraw the pressing tool: what the wall stored is motion soon, and then gone."""
    tools.position_m[0] = AWAY_M
    book = EnergyBook(simulation)
    for _ in range(25):
        book.step(tools)
    return book


@pytest.mark.parametrize("spoilt", ["velocity_m_s", "position_m"])
def test_a_heal_brings_back_no_energy_that_was_gone(pressed, spoilt):
    """Before, the wall was pressed in again with nobody there: 76 uJ, more than twice what the hand had worked."""
    simulation, tools, _ = pressed
    book = let_go(simulation, tools)
    spent_j, largest_j = book.flow.input_j - book.flow.stored_j, 0.0
    original = book.end

    def end(dt_s):
        original(dt_s)
        getattr(simulation.catheter.state, spoilt)[-1] = np.nan if spoilt == "position_m" else too_fast_m_s(simulation)
        book.end = original

    book.end = end
    for _ in range(100):
        book.step(tools)
        largest_j = max(largest_j, abs(book.flow.input_j), abs(book.flow.stored_j))
        assert book.flow.input_j - book.flow.stored_j > spent_j - 0.01 * largest_j
        assert abs(book.flow.imbalance_j) < 0.01 * largest_j
    assert simulation.healed_states == 1
    assert largest_j > 1e-6


def test_a_heal_gives_nothing_back_that_the_hands_had_lost(pressed):
    """Before, couplings were stretched again as they had been: a quarter of all energy in it, put in by nobody."""
    simulation, tools, _ = pressed
    stretched_j = 0.5 * np.sum(simulation.tools.stiffness * simulation.tools.stretch**2)
    tools.present[:] = False
    tools.position_m[0] = AWAY_M
    book, spoiled = EnergyBook(simulation), []
    book.step(tools)
    lost_j = book.flow.input_j - book.flow.stored_j
    original = book.end

    def end(dt_s):
        original(dt_s)
        if not spoiled:
            spoiled.append(True)
            simulation.catheter.state.position_m[-1] = np.nan

    book.end = end
    for _ in range(2):  # it is spoilt at the end of a step, and healed at the start of the next
        book.step(tools)
    assert simulation.healed_states == 1
    assert stretched_j > 1e-6
    assert book.flow.input_j - book.flow.stored_j > lost_j - 0.05 * stretched_j
    assert not simulation.tools.stretch.any()
