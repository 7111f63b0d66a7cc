"""States that heal to ones which at once become unsound again: each heal goes further back, to the first at last."""

import numpy as np
import pytest

from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation
from services.mechanics.simulation.copies import FIRST as FIRST_PLACE
from services.mechanics.simulation.copies import PLACES, Copies
from services.mechanics.simulation.healing import MOST_STRETCH
from studies.energy_book import EnergyBook

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
    return np.concatenate([simulation.duct_state.q, simulation.catheter.state.position_m.ravel()])


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


def test_heals_that_follow_each_other_go_further_back_to_the_first_state_at_last(pressed):
    simulation, tools, first = pressed
    Spoiler(simulation, lambda _: True)
    away, ticks = [], 3 * PLACES
    for tick in range(ticks):
        tools.position_m[0, 0] = PRESSING_M[0] + 5e-3 * np.sin(1e-2 * tick)
        simulation.step(tools)
        away.append(np.abs(state(simulation) - first).max())
        assert not simulation.catheter.state.velocity_m_s.any()
        assert not simulation.tool_results.force_n.any()
    assert away == sorted(away, reverse=True)
    assert away[0] > away[1] > 0.0
    assert away[PLACES] == 0.0
    assert simulation.healed_states == ticks
    simulation.watcher = None
    simulation.step(tools)
    assert simulation.healed_states == ticks


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


def test_what_stores_no_more_is_as_young_as_it_can_be(pressed):
    """A scene at rest that is spoilt goes back by two copies, not to its beginning."""
    simulation, tools, first = pressed
    was = state(simulation)
    Spoiler(simulation, lambda _: True)
    simulation.step(tools)
    assert simulation.healed_states == 1
    assert np.abs(state(simulation) - was).max() < 0.5 * np.abs(first - was).max()


def test_copies_are_many_of_late_and_few_of_old():
    """Places hold what is at most 2, 4, 8, ... copies old, and the newest is not trusted."""
    live = np.zeros(1)
    copies = Copies([live])
    for count in range(1, 5 * 2**PLACES):
        live[0] = count
        copies.keep()
        ages = []
        for place in copies.places():
            copies.put_back(place)
            ages.append(count - int(live[0]))
        assert ages[-1] == count
        assert ages == sorted(ages)
        assert all(age > 0 for age in ages)
        if count >= 2**PLACES:
            assert len(ages) == PLACES
            assert all(age <= 2 ** (k + 2) for k, age in enumerate(ages[:-1]))
        live[0] = count


def test_a_copy_that_was_taken_up_is_forgotten_and_what_came_of_it():
    live = np.zeros(1)
    copies = Copies([live])
    for count in range(1, 20):
        live[0] = count
        copies.keep()
    place = copies.places()[1]
    copies.put_back(place)
    taken = live[0]
    copies.go_on_before(place)
    for left in copies.places():
        copies.put_back(left)
        assert live[0] < taken
    before = copies.places()
    live[0] = 20
    copies.keep()
    assert copies.places() == before
    copies.go_on_before(FIRST_PLACE)
    assert copies.places() == [FIRST_PLACE]


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
