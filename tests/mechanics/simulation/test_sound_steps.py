"""A step that does not end soundly keeps the share of its motion that is sound, and the rest is counted."""

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.collision.pairs import NO_TOOL
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.price import MARGIN
from trocar.services.mechanics.contact.working_set import tolerated_overlap_m
from trocar.services.mechanics.reduction.wall_step.energy_tank import MOST_OWED
from trocar.services.mechanics.reduction.wall_step.implicit_step import CREDIT_J, ENERGY, TANK
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation, step_solver
from trocar.services.mechanics.simulation.simulation import INDEBTED_STEP_S
from trocar.services.mechanics.simulation.sound_start import begin_sound
from trocar.studies.judge.overlaps import OverlapJudge
from trocar.studies.stability.finely import contact_forces_n

ROUNDING_M = 1e-6
"""The judge and the price measure walls that are placed by different sums."""


def press(simulation, ticks, after=lambda tick: None):
    """Two forceps come down on the duct at 0.1 m/s, and go on into it."""
    tools = ToolInputs()
    for tick in range(ticks):
        tools.position_m[:] = (20e-3, 0.0, 21.5e-3 - 0.1e-3 * tick), (30e-3, 3e-3, 21.5e-3 - 0.1e-3 * tick)
        simulation.step(tools)
        after(tick)


def leave_without_rows(simulation, monkeypatch):
    """Let no candidate ever get a row, and a tick have work for one try only."""
    monkeypatch.setattr(simulation.search, "write_pairs", lambda state, pairs: None)
    monkeypatch.setattr(step_solver, "append_copies", lambda known, found: None)
    monkeypatch.setattr(step_solver, "MOST_PRODUCTS", 1)


def test_a_solve_without_rows_that_does_not_end_takes_nothing_deeper_than_is_sound(
    small_scene, small_duct, monkeypatch
):
    """Tools go on at 0.1 m/s, and no candidate ever gets a row: the motion is taken back, or nothing moves."""
    simulation = Simulation(small_scene, small_duct)
    press(simulation, 5)
    judge, tolerance_m = OverlapJudge(simulation), tolerated_overlap_m(small_scene.duct.thickness_m)
    leave_without_rows(simulation, monkeypatch)
    worst_m = []
    press(simulation, 60, lambda _: worst_m.append(max(judge.look().values())))
    assert max(worst_m) < MARGIN * tolerance_m + ROUNDING_M
    assert max(worst_m) > tolerance_m, "nothing was pressed"
    assert simulation.withheld_s > 5e-3
    assert simulation.healed_states == 0


def test_a_share_of_a_motion_lies_between_its_ends_and_gives_out_no_energy(small_scene, small_duct):
    simulation = Simulation(small_scene, small_duct)
    press(simulation, 40)
    share, duct, rod = simulation._motion_share, simulation.duct, simulation.catheter.state
    tools = ToolInputs()
    tools.position_m[:] = simulation.tools.hand[:, :3] + [0.0, 0.0, -0.3e-3]

    def state():
        return duct.state.q.copy(), duct.state.qdot.copy(), rod.position_m.copy(), rod.velocity_m_s.copy()

    def energy_j():
        return duct.kinetic_energy_j() + duct.strain_energy_j()

    begun, begun_j = state(), energy_j()
    simulation._start.save()
    assert simulation._move(tools, 1e-3)
    ended, ended_j = state(), energy_j()
    assert share.find(1.0, 1.0, 0.125) == 1.0
    for part in (1.0, 0.25):
        share.take(part)
        for start, end, now in zip(begun, ended, state(), strict=True):
            assert now == pytest.approx(start + part * (end - start), rel=1e-12, abs=1e-15)
        assert energy_j() <= (1.0 - part) * begun_j + part * ended_j + 1e-15


@pytest.mark.parametrize("sound", [0.0, 0.5])
def test_a_tool_that_appears_where_not_all_of_a_part_is_sound_is_at_its_hand(
    small_scene, small_duct, monkeypatch, sound
):
    """It was on the way there from the scene's origin: a jaw lay across the wall."""
    simulation = Simulation(small_scene, small_duct)
    move, find = simulation._move, simulation._motion_share.find
    monkeypatch.setattr(simulation, "_move", lambda *given: move(*given) and False)
    monkeypatch.setattr(simulation._motion_share, "find", lambda *given: sound * find(*given))
    tools = ToolInputs(jaw_angle_rad=np.full(2, 0.4), roll_rad=np.full(2, 0.3))
    tools.position_m[:] = (20e-3, 0.0, 30e-3), (30e-3, 3e-3, 30e-3)
    simulation.step(tools)
    body = simulation.tools
    assert simulation.withheld_s > 0.0
    assert body.present.all()
    assert body.proxy == pytest.approx(np.column_stack([tools.position_m, tools.jaw_angle_rad]), abs=1e-12)
    assert np.array_equal(body.roll_rad, tools.roll_rad)


def test_a_tick_without_work_left_withholds_all_of_its_time_and_moves_nothing(small_scene, small_duct, monkeypatch):
    simulation = Simulation(small_scene, small_duct)
    press(simulation, 40)
    q, line_m = simulation.duct.state.q.copy(), simulation.catheter.state.position_m.copy()
    monkeypatch.setattr(step_solver, "MOST_PRODUCTS", 0)
    simulation.step(ToolInputs())
    assert simulation.withheld_s == pytest.approx(1e-3)
    assert np.array_equal(simulation.duct.state.q, q)
    assert np.array_equal(simulation.catheter.state.position_m, line_m)


def test_a_motion_that_owes_energy_does_not_happen_however_short_it_is(with_effects, small_duct, monkeypatch):
    """Such a motion was accepted where it could not be divided any more: a drawn wall gained a fifth of its energy."""
    scene = with_effects(nonlinear_membrane={"n_coordinates": 6})
    simulation = Simulation(scene, small_duct)
    press(simulation, 40)
    q = simulation.duct.state.q.copy()
    monkeypatch.setattr(type(simulation.duct.terms), "is_settled", False)
    simulation.step(ToolInputs())
    assert simulation.withheld_s == pytest.approx(1e-3)
    assert np.array_equal(simulation.duct.state.q, q)


class Parts:
    """Notes how long the parts of ticks are that have happened."""

    def __init__(self):
        self.lengths_s = []

    def begin(self):
        """Nothing: see `Watcher`."""

    def end(self, dt_s):
        self.lengths_s.append(dt_s)


@pytest.mark.parametrize(("most_products", "lengths_s"), [(None, [INDEBTED_STEP_S] * 8), (1, [0.0])])
def test_a_part_whose_contacts_give_more_than_their_credit_is_divided(
    small_scene, small_duct, monkeypatch, most_products, lengths_s
):
    """To an eighth of a tick, where it may stand; a tick without work for that does not happen."""
    simulation, watcher = Simulation(small_scene, small_duct), Parts()
    press(simulation, 40)
    tools = ToolInputs()
    tools.position_m[:] = simulation.tools.hand[:, :3]
    monkeypatch.setattr(type(simulation.system), "owes_nothing", False)
    if most_products is not None:
        monkeypatch.setattr(step_solver, "MOST_PRODUCTS", most_products)
    simulation.watcher = watcher
    simulation.step(tools)
    assert watcher.lengths_s == pytest.approx(lengths_s)
    assert simulation.withheld_s == pytest.approx(1e-3 - sum(lengths_s))


def test_a_share_of_a_motion_rolls_its_tools_by_that_share(small_scene, small_duct):
    simulation = Simulation(small_scene, small_duct)
    press(simulation, 40)
    tools = ToolInputs(roll_rad=np.array([0.02, -0.03]))
    tools.position_m[:] = simulation.tools.hand[:, :3]
    simulation._start.save()
    assert simulation._move(tools, 1e-3)
    assert simulation._motion_share.find(1.0, 1.0, 0.125) == 1.0
    simulation._motion_share.take(0.25)
    assert simulation.tools.rolled_rad == pytest.approx([5e-3, -7.5e-3])
    assert simulation.tools.roll_rad == pytest.approx([5e-3, -7.5e-3])


def test_a_wall_that_owes_what_it_once_stored_much_of_does_not_stand_still_for_it(with_effects, small_duct):
    """A debt of a hundredth of what was stored was more than that where the wall had come to rest: 100 ticks stood."""
    scene = with_effects(nonlinear_membrane={"n_coordinates": 6})
    simulation = Simulation(scene, small_duct)
    press(simulation, 40)
    for _ in range(500):
        simulation.step(ToolInputs())
    books = simulation.duct.terms.step.books
    books[TANK] = begun_j = -CREDIT_J - 2.0 * MOST_OWED * abs(books[ENERGY])
    for _ in range(10):
        simulation.step(ToolInputs())
    assert simulation.withheld_s == 0.0
    assert books[TANK] >= begun_j


def test_a_wall_whose_loads_press_it_through_the_catheter_begins_beside_it(small_scene, small_duct):
    """It began in equilibrium with the loads, beyond the catheter, and no step could bring it back."""
    simulation = Simulation(small_scene, small_duct)
    judge, duct = OverlapJudge(simulation), simulation.duct
    place_m = duct.reduced.mesh.vertices_m
    load_n = np.zeros_like(place_m)
    load_n[place_m[:, 2] > 0.0, 2] = -1.0
    duct.set_constant_load(load_n)
    lowest_m = simulation.catheter.state.position_m[:, 2].min()
    height_m = duct.surface_m()[place_m[:, 2] > 0.0, 2].min()
    assert height_m < lowest_m, "the load does not press the wall through the catheter"
    whole = duct.state.q.copy()
    begin_sound(simulation.world)
    assert 0.0 < np.linalg.norm(duct.state.q) < np.linalg.norm(whole)
    worst_m = [judge.look()["catheter"]]
    press(simulation, 30, lambda _: worst_m.append(judge.look()["catheter"]))
    assert max(worst_m) < 0.1e-3


def test_a_wall_whose_loads_press_it_through_a_stone_begins_beside_it(with_effects, small_duct):
    """Stones came after the wall's shape, which began 0.6 mm deep in one."""
    gas = {"outside_pa": 30e3, "inside_pa": 0.0}
    stone = {"position_m": [[20e-3, 0.0, -2.2e-3]], "radius_m": [1.2e-3]}
    simulation = Simulation(with_effects(insufflation=gas, gallstones=stone), small_duct)
    judge, q = OverlapJudge(simulation), simulation.duct.state.q
    assert judge.look()["stones"] < 0.05e-3
    whole = Simulation(with_effects(insufflation=gas), small_duct).duct.state.q
    assert 0.0 < np.linalg.norm(q) < np.linalg.norm(whole)
    q[:] = whole
    assert judge.look()["stones"] > 0.3e-3, "the pressure does not press the wall through the stone"


def test_a_particle_has_one_film_of_mucus_however_many_facets_it_is_near(with_effects, small_duct):
    """Films were half of the rows where a table of 256 was full."""
    scene = with_effects(mucus_drag={})
    catheter = replace(
        scene.catheter, anchor="free", length_m=20e-3, n_segments=10, tip_position_m=(10e-3, 0.0, -2.35e-3)
    )
    simulation = Simulation(replace(scene, catheter=catheter), small_duct)
    simulation.step(ToolInputs(present=np.zeros(2, np.bool_)))
    rows = simulation.contacts
    films = np.flatnonzero(rows.law[: rows.n_contacts] == number_of("film"))
    assert sorted(rows.rod_node[films, 0]) == list(range(11))
    assert (rows.tool[films] == NO_TOOL).all()


def test_a_tick_takes_hardly_more_work_than_it_may_and_stays_sound(small_scene, small_duct, monkeypatch):
    """Whatever is left when a solve begins: it was asked between solves only."""
    simulation, most, products, worst_m = Simulation(small_scene, small_duct), 200_000, [], []
    press(simulation, 5)
    judge, tolerance_m = OverlapJudge(simulation), tolerated_overlap_m(small_scene.duct.thickness_m)
    monkeypatch.setattr(step_solver, "MOST_PRODUCTS", most)

    def look(tick):
        products.append(simulation.solver.products)
        worst_m.append(max(judge.look().values()))

    press(simulation, 60, look)
    assert max(products) > most
    assert max(products) < 2 * most, "one part and its looks"
    assert max(worst_m) < MARGIN * tolerance_m + ROUNDING_M


@pytest.fixture
def without_rows(small_scene, small_duct, monkeypatch):
    """A world in which two tools have come down as far as is sound where nothing ever gets a row."""
    simulation = Simulation(small_scene, small_duct)
    press(simulation, 5)
    leave_without_rows(simulation, monkeypatch)
    press(simulation, 60)
    return simulation


def test_a_stuck_world_is_tried_again_only_when_a_hand_a_load_or_the_state_is_another(without_rows, monkeypatch):
    simulation, tools, tries = without_rows, ToolInputs(), []
    tools.position_m[:] = (20e-3, 0.0, 15e-3), (30e-3, 3e-3, 15e-3)
    move = simulation._move
    monkeypatch.setattr(simulation, "_move", lambda *given: tries.append(1) or move(*given))

    def tries_of_a_tick():
        tries.clear()
        before_s, before = simulation.withheld_s, simulation.catheter.state.position_m.copy()
        simulation.step(tools)
        if not tries:
            assert simulation.withheld_s == pytest.approx(before_s + 1e-3)
            assert simulation.solver.products == 0
            assert np.array_equal(before, simulation.catheter.state.position_m)
        return len(tries)

    def is_left_alone():
        """Whether that comes to be so: each tick may find a little motion that is sound, in parts that are shorter."""
        return any(tries_of_a_tick() == 0 for _ in range(200)) and [tries_of_a_tick() for _ in range(3)] == [0, 0, 0]

    assert tries_of_a_tick() == 1, "the products of a tick are spent by one try"
    assert is_left_alone()
    tools.position_m[0, 0] += 10e-6
    assert tries_of_a_tick() == 0, "so little changes nothing"
    tools.position_m[0, 0] += 0.1e-3
    assert tries_of_a_tick() > 0, "a hand has moved"
    assert is_left_alone()
    simulation.catheter.constant_force_n[-1, 2] += 1e-9
    assert tries_of_a_tick() > 0, "a load is another"


def test_a_stuck_world_moves_on_as_soon_as_there_is_a_sound_motion(without_rows, monkeypatch):
    simulation, tools = without_rows, ToolInputs()
    tools.position_m[:] = (20e-3, 0.0, 15e-3), (30e-3, 3e-3, 15e-3)
    for _ in range(5):
        simulation.step(tools)
    before_s = simulation.withheld_s
    tools.position_m[:, 2] += 30e-3
    for _ in range(20):
        simulation.step(tools)
    assert simulation.withheld_s - before_s < 3e-3
    assert (simulation.tools.proxy[:, 2] > 20e-3).all()


def test_what_a_try_has_found_gets_rows_in_the_next_one(small_scene, small_duct, monkeypatch):
    """Work for one price a tick is enough: a stuck world had found the same places in every tick, and stood still."""
    simulation = Simulation(small_scene, small_duct)
    press(simulation, 5)
    monkeypatch.setattr(simulation.search, "write_pairs", lambda state, pairs: None)
    monkeypatch.setattr(step_solver, "MOST_PRODUCTS", 1)
    judge, tolerance_m, worst_m = OverlapJudge(simulation), tolerated_overlap_m(small_scene.duct.thickness_m), []
    begun_s = simulation.withheld_s
    press(simulation, 60, lambda _: worst_m.append(max(judge.look().values())))
    assert tolerance_m < max(worst_m) < MARGIN * tolerance_m + ROUNDING_M
    assert simulation.solver.pricing.new_rows == 0, "no tick has had the work for a second solve"
    assert simulation.withheld_s - begun_s < 0.75 * 60e-3
    pricing, known = simulation.solver.pricing, []
    monkeypatch.setattr(pricing, "append_known", lambda: known.append(pricing.n_known))
    while not pricing.n_known:
        simulation.step(ToolInputs(position_m=simulation.tools.hand[:, :3] - [0.0, 0.0, 1e-4]))
    known.clear()
    simulation.catheter.state.position_m[-1, 2] += 1e-9
    simulation.step(ToolInputs(position_m=simulation.tools.hand[:, :3] + 0.0))
    assert known[0] == 0, "the state is another"


@pytest.mark.parametrize("spent_by", ["the solve", "the looks"])
def test_a_tick_of_which_nothing_happens_is_felt_as_the_one_before(small_scene, small_duct, monkeypatch, spent_by):
    """The forces of a try that came to nothing are borne by nobody."""
    simulation = Simulation(small_scene, small_duct)
    press(simulation, 40)
    felt = simulation.tool_results
    names = "force_n", "port_moment_nm", "grasp_torque_nm", "proxy_position_m"
    before = {name: getattr(felt, name).copy() for name in names}
    assert np.linalg.norm(before["force_n"]) > 0.01

    def solve(dt_s):
        simulation.contacts.force_n[:], simulation.system.force_n[:] = 50.0, 50.0
        simulation.solver.tool_force[:] = 100.0
        simulation.solver.products += step_solver.MOST_PRODUCTS * (spent_by == "the solve")
        return False

    def find(tolerance_m, detected_share, quantum):
        simulation.solver.products += step_solver.MOST_PRODUCTS * (spent_by == "the looks")
        return 0.0

    monkeypatch.setattr(simulation.solver, "solve", solve)
    monkeypatch.setattr(simulation._motion_share, "find", find)
    simulation.step(ToolInputs(position_m=simulation.tools.hand[:, :3] - [0.0, 0.0, 1e-3]))
    assert simulation.withheld_s == pytest.approx(1e-3)
    for name, value in before.items():
        assert np.array_equal(getattr(felt, name), value), name
    assert contact_forces_n(simulation) == pytest.approx(felt.force_n, abs=1e-12)


def falls_freely(simulation, monkeypatch):
    """Let contacts have no force, so that only the share of the motion keeps bodies out of each other."""

    def solve(dt_s):
        simulation.system.clear()
        simulation.system.clear_forces()
        simulation.solver._apply()
        return not simulation.solver.pricing.finds_violations()

    monkeypatch.setattr(simulation.solver, "solve", solve)


def absent():
    return ToolInputs(present=np.zeros(2, np.bool_))


def test_strands_of_a_catheter_keep_the_share_of_their_motion_at_which_they_are_clear(
    with_effects, small_duct, monkeypatch
):
    scene = with_effects(self_contact={})
    catheter = replace(scene.catheter, anchor="free", tip_position_m=(100e-3, 50e-3, 0.0), n_segments=40)
    simulation = Simulation(replace(scene, catheter=catheter), small_duct)
    state, judge = simulation.catheter.state, OverlapJudge(simulation)
    angle = np.linspace(0.0, 2.3 * np.pi, 41)
    radius_m = 0.1 / (2.3 * np.pi)
    line = np.stack([0.1 + radius_m * np.cos(angle), 0.1 + radius_m * np.sin(angle), 0.4e-3 * angle], axis=1)
    state.position_m[:] = line
    simulation.step(absent())
    falls_freely(simulation, monkeypatch)
    deepest_m = []
    state.position_m[:], state.velocity_m_s[:] = line, 0.0  # it has begun to uncoil
    state.velocity_m_s[20:, 2] = -1.5
    for _ in range(3):
        simulation.step(absent())
        deepest_m.append(judge.look()["strands"])
    tolerance_m = tolerated_overlap_m(scene.duct.thickness_m)
    assert tolerance_m < max(deepest_m) < MARGIN * tolerance_m + ROUNDING_M
    assert simulation.healed_states == 0


def test_a_stone_keeps_the_share_of_its_motion_at_which_it_is_clear_of_the_catheter(
    with_effects, small_duct, monkeypatch
):
    simulation = Simulation(with_effects(gallstones={}), small_duct)
    stone, rod, judge = simulation.effects["gallstones"], simulation.catheter, OverlapJudge(simulation)
    apart_m = stone.radius_m[0] + rod.radius_m
    stone.position_m[0] = rod.state.position_m[15] + [0.0, apart_m + 0.2e-3, 0.0]
    falls_freely(simulation, monkeypatch)
    deepest_m = []
    for _ in range(10):
        stone.velocity_m_s[0] = 0.0, -0.5, 0.0
        simulation.step(absent())
        deepest_m.append(judge.look()["stones"])
    tolerance_m = tolerated_overlap_m(simulation.scene.duct.thickness_m)
    assert tolerance_m < max(deepest_m) < MARGIN * tolerance_m + ROUNDING_M
    assert simulation.withheld_s > 5e-3


@pytest.mark.parametrize(
    ("clear_from", "clear_to", "expected"), [(0.95, 0.1, 0.0), (0.8, 0.1, 0.875), (0.95, 0.3, 0.125)]
)
def test_a_share_that_is_taken_was_looked_at(small_scene, small_duct, monkeypatch, clear_from, clear_to, expected):
    """Jaws are deep in a wall half way and clear of it at 0.97 of the motion: 0.875 of it was taken, 0.1 mm deep."""
    simulation = Simulation(small_scene, small_duct)
    simulation._start.save()
    simulation._move(ToolInputs(), 1e-3)
    looked = []

    def depths_m(share):
        looked.append(share)
        return np.array([0.0 if share >= clear_from or share <= clear_to else 100e-6])

    monkeypatch.setattr(simulation._motion_share, "_depths_m", depths_m)
    found = simulation._motion_share.find(30e-6, 0.97, 0.125)
    assert found == expected
    assert found in {*looked, 0.0}


def test_only_the_looks_that_were_made_are_charged(small_scene, small_duct):
    """The start, and the whole motion if that is sound."""
    simulation = Simulation(small_scene, small_duct)
    press(simulation, 5)
    simulation._start.save()
    simulation._move(ToolInputs(position_m=simulation.tools.hand[:, :3].copy()), 1e-3)
    assert simulation._motion_share.find(30e-6, 1.0, 0.125) == 1.0
    assert simulation._motion_share.looks == 2


def test_places_that_a_solve_cut_short_leads_to_get_no_rows(small_scene, small_duct, monkeypatch):
    """Worlds in which no solve ended found 24 such places in each tick, until the table was full of their rows."""
    simulation = Simulation(small_scene, small_duct)
    pricing, problem = simulation.solver.pricing, simulation.system._state.problem

    def price(_system, _tolerance_m, pairs):
        pairs.count = 3
        return 3

    monkeypatch.setattr(simulation.search, "price", price)
    for is_cut, n_known in ((True, 0), (False, 3)):
        problem.is_cut = is_cut
        assert pricing.finds_violations()
        assert pricing.n_known == n_known
