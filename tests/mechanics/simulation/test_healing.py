"""States that are not sound, from whatever a caller does: the last sound one comes back, at rest."""

import numpy as np
import pytest

from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.healing import AGAIN, MOST_STRETCH
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


def presses(simulation):
    contacts = simulation.contacts
    return bool((contacts.tool[: contacts.n_contacts] == 0).any())


def test_a_tool_that_makes_every_healed_state_unsound_is_limp_until_it_has_been_withdrawn(pressed):
    simulation, tools, _ = pressed
    Spoiler(simulation, presses)
    for _ in range(500):
        simulation.step(tools)
    assert simulation.healed_states == 2
    assert not presses(simulation)
    assert not simulation.tool_results.force_n.any()
    simulation.watcher = None
    inside = tools.position_m[0].copy()
    for part in np.linspace(0.0, 1.0, 300):
        tools.position_m[0] = inside + np.array([0.0, 0.0, 10e-3 * np.sin(np.pi * part)])
        simulation.step(tools)
    assert presses(simulation)
    assert simulation.healed_states == 2


def test_heals_that_do_not_help_leave_everything_at_rest_where_it_was(pressed):
    simulation, tools, _ = pressed
    was = state(simulation)
    Spoiler(simulation, lambda _: True)
    for tick in range(5):
        tools.position_m[0, 0] = PRESSING_M[0] + 5e-3 * np.sin(1e-2 * tick)
        simulation.step(tools)
        assert np.array_equal(state(simulation), was)
        assert not simulation.catheter.state.velocity_m_s.any()
        assert not simulation.tool_results.force_n.any()
    assert simulation.healed_states == 5


def test_a_state_that_a_caller_has_torn_is_replaced_by_the_last_sound_copy(pressed):
    """The start of the step is that state itself."""
    simulation, tools, first = pressed
    line_m = simulation.catheter.state.position_m
    whole_m = line_m.copy()
    line_m[-10:, 0] += 30e-3
    simulation.step(tools)
    assert simulation.healed_states == 1
    assert np.abs(line_m - whole_m).max() < 3e-3
    assert np.abs(state(simulation) - first).max() > 1e-5, "it is not the first state"


def test_a_heal_that_has_helped_is_followed_by_another_like_it(pressed):
    simulation, tools, first = pressed
    spoiler = Spoiler(simulation, lambda _: True)
    for is_due in (True, *(AGAIN + 1) * (False,), True):
        simulation.watcher = spoiler if is_due else None
        simulation.step(tools)
    assert simulation.healed_states == 2
    assert np.abs(state(simulation) - first).max() > 1e-5


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
        getattr(simulation.catheter.state, spoilt)[-1] = np.nan if spoilt == "position_m" else too_fast_m_s(simulation)
        original(dt_s)
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
        if not spoiled:
            spoiled.append(True)
            simulation.catheter.state.position_m[-1] = np.nan
        else:
            original(dt_s)

    book.end = end
    book.step(tools)
    assert simulation.healed_states == 1
    assert stretched_j > 1e-6
    assert book.flow.input_j - book.flow.stored_j > lost_j - 0.05 * stretched_j
    assert not simulation.tools.stretch.any()
