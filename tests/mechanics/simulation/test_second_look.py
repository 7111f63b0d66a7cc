"""What only the solved motion of a step brings into each other has a row in that step."""

from dataclasses import replace

import numpy as np
import pytest

from services.mechanics.collision.pairs import DUCT_TRIANGLE, JAW_A, JAW_B, NO_TOOL, ContactPairs
from services.mechanics.contact.laws import number_of
from services.mechanics.contact.met import keep_approaching
from services.mechanics.contact.pair_rows import append_pairs
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation
from services.mechanics.simulation.second_look import SecondLook, slides_far
from studies.stability.criteria import failures
from studies.stability.drive import reduced_duct
from studies.stability.families.jerks import cases as jerks
from studies.stability.families.materials import mass_cases
from studies.stability.families.walls import thickness_cases
from studies.stability.family import Draw, Reach
from studies.stability.hands import least_jerk
from studies.stability.situations import LEAD_STEPS, threaded


def beyond(figures):
    """The figures beyond their limits, but for heals and contact forces, which are rates of the long run."""
    return {name: figures[name] for name in failures(figures) if name not in ("healed", "force_step", "felt_error")}


def long(*values):
    """A case of the long run."""
    return pytest.param(*values, marks=pytest.mark.long)


@pytest.mark.parametrize(
    ("family", "name"),
    [
        (mass_cases, "wall 0.01 times as heavy, number 2"),  # 0.49 mm deep with rows of the first look only
        long(jerks, "holding, 0.1 m/s, number 84"),  # 0.21 mm: a wall that detection saw elsewhere, too
        long(jerks, "holding, 0.1 m/s, number 56"),
    ],
)
def test_walls_that_snap_beside_a_row_meet_nothing_unseen(family, name):
    (case,) = [case for case in family(Draw(Reach.LONG, 1)) if case.name == name]
    figures = case.run().figures
    assert not beyond(figures)


@pytest.mark.parametrize(
    ("seed", "name"),
    [
        (1, "t/R 0.002, holding, number 0"),  # 0.63 walls deep where a point beside a row had none
        long(1, "t/R 0.002, holding, number 1"),  # 0.63
        long(1, "t/R 0.005, holding, number 2"),  # 1.16
        long(2, "t/R 0.005, holding, number 0"),
        long(2, "t/R 0.01, holding, number 0"),
        long(2, "t/R 0.005, holding, number 2"),  # 0.69 where detection takes the wall to be beside where it is
    ],
)
def test_walls_of_a_sheet_of_paper_are_no_deeper_in_jaws_than_half_of_that(seed, name):
    """A few are not, see docs/decisions/overlaps.md; and the catheter is deeper than that between its particles."""
    (case,) = [case for case in thickness_cases(Draw(Reach.LONG, seed)) if case.name == name]
    figures = case.run().figures
    assert not beyond(figures).keys() - {"penetration_hand", "penetration_any"}


@pytest.mark.parametrize(("thickness_m", "most"), [(1e-3, 3), (0.2e-3, 3), (0.1e-3, 8)])
def test_a_thin_wall_is_looked_at_more_often(monkeypatch, thickness_m, most):
    """As long as each look meets something, and no further."""
    looks = []
    monkeypatch.setattr(SecondLook, "is_due", lambda look: True)
    monkeypatch.setattr(SecondLook, "append_rows", lambda look, *, knows_tools: bool(looks.append(None)) or True)
    start = threaded()
    scene = replace(start.scene, duct=replace(start.scene.duct, thickness_m=thickness_m))
    Simulation(scene, reduced_duct(scene)).step(ToolInputs())
    assert len(looks) == most


def _jerked(monkeypatch, is_due, *, given_pairs=False):
    """The state after a jerk of the steadying tool, and the simulation."""
    monkeypatch.setattr(SecondLook, "is_due", is_due)
    start = threaded()
    hands = start.hands.then(150).moved(1, least_jerk(5e-3, np.array([0.0, 0.0, -1.0]), 0.2), LEAD_STEPS)
    simulation, tools = Simulation(start.scene, reduced_duct(start.scene)), ToolInputs()
    pairs = ContactPairs.allocate(start.scene.contact.capacity)
    for step in range(len(hands)):
        hands.write(step, tools)
        simulation.step(tools, pairs if given_pairs else None)
    rod, wall = simulation.catheter.state, simulation.duct.state
    return simulation, (rod.position_m, rod.velocity_m_s, wall.q, wall.qdot, simulation.tools.proxy)


@pytest.mark.parametrize(
    ("tool", "slide_um", "is_far"),
    [(NO_TOOL, 200, False), (NO_TOOL, 340, False), (NO_TOOL, 360, True), (0, 40, False), (0, 60, True)],
)
def test_what_touches_nothing_goes_as_far_as_its_gap_beyond_what_is_far(
    small_scene, small_duct, tool, slide_um, is_far
):
    """A particle that swings in the lumen meets nothing; beside a tool a wall bulges."""
    state = Simulation(small_scene, small_duct).system._state
    state.rows.n_contacts, state.rows.law[0], state.rows.tool[0] = 1, number_of("unilateral"), tool
    state.rows.gap_m[0] = state.problem.motion[0] = 300e-6
    state.problem.motion[1] = 1e-6 * slide_um
    assert slides_far(state.address, 50e-6) == is_far


@pytest.mark.parametrize(("particle", "gap_um", "is_far"), [(5, 40, True), (5, 160, False), (6, 40, False)])
def test_what_is_near_something_else_has_no_room_to_go_so_far(small_scene, small_duct, particle, gap_um, is_far):
    """Between the lips of a mouth one is near where the other is not: nobody looked, and that came 0.17 mm deeper."""
    state = Simulation(small_scene, small_duct).system._state
    rows, motion = state.rows, state.problem.motion
    rows.n_contacts, rows.law[:2], rows.tool[:2] = 2, number_of("unilateral"), NO_TOOL
    rows.rod_node[:2, 0], rows.rod_weight[:2, 0] = (5, particle), 1.0
    rows.gap_m[:2] = motion[[0, 3]] = 300e-6, 1e-6 * gap_um
    motion[1] = 200e-6
    assert slides_far(state.address, 50e-6) == is_far


@pytest.mark.parametrize("turned_rad", [0.2, 1.0, 1.5, 1.8, 3.1])
def test_what_a_solve_takes_round_or_through_a_tool_is_kept_on_the_side_where_it_began(
    small_scene, small_duct, turned_rad
):
    """Before, from a right angle on, it was taken to have been deep in the tool from the other side all along."""
    simulation = Simulation(small_scene, small_duct)
    state, pairs, apart_m = simulation.system._state, ContactPairs.allocate(1), 1.8e-3
    jaws, wall, end_gap_m = state.geometry.tools, state.geometry.wall, -0.3e-3
    jaws.present[0], jaws.segments[0, JAW_A], jaws.radius[0, JAW_A] = True, [[0.0, 0.0, 0.0], [10e-3, 0.0, 0.0]], 1e-3
    away = np.array([0.0, np.cos(turned_rad), np.sin(turned_rad)])
    pairs.count, pairs.tool[0], pairs.tool_segment[0], pairs.tool_parameter[0] = 1, 0, JAW_A, 0.5
    pairs.target_weights[0], pairs.normal[0], pairs.gap_m[0] = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), end_gap_m
    corners = np.array([5e-3, 0.0, 0.0]) - apart_m * np.array([away, away, away])
    keep_approaching(pairs.address, simulation.system.address, corners)
    nearest_m = apart_m - 1e-3 - wall.half_thickness
    start_m = apart_m * away[1] - 1e-3 - wall.half_thickness
    assert pairs.count == 1
    assert np.allclose(pairs.normal[0], away if start_m < 0.0 else (0.0, 1.0, 0.0), atol=1e-12)
    assert np.isclose(pairs.gap_m[0], (nearest_m if start_m < 0.0 else start_m) - end_gap_m, atol=1e-12)


def found(triangle, weights, segment, normal):
    """The pair of a jaw of the first tool, at its middle, with a point of the wall."""
    pairs = ContactPairs.allocate(1)
    pairs.count, pairs.tool[0], pairs.tool_segment[0], pairs.tool_parameter[0] = 1, 0, segment, 0.5
    pairs.particle[0], pairs.target_kind[0], pairs.target[0] = -1, DUCT_TRIANGLE, triangle
    pairs.target_weights[0], pairs.normal[0] = weights, normal
    return pairs


@pytest.mark.parametrize(
    ("apart_um", "segment", "turned_rad", "is_kept"),
    [
        (0, JAW_A, 0.0, False),
        (15, JAW_A, 0.15, False),
        (60, JAW_A, 0.0, True),  # another point
        (0, JAW_B, 0.0, True),  # another piece of the tool
        (0, JAW_A, 0.5, True),  # another flank
    ],
)
def test_a_look_gives_a_point_of_the_wall_that_has_a_row_no_second_one(
    small_scene, small_duct, apart_um, segment, turned_rad, is_kept
):
    """However deep it ends, beyond the edge of a triangle as well; here what is within 30 um is one point.

    Before, a row's point in the room was compared with a pair's as seen from the jaws' joint: never alike.
    """
    system, mesh, one = Simulation(small_scene, small_duct).system, small_duct.mesh, 60
    shared = np.isin(mesh.triangles, mesh.triangles[one])
    across = next(k for k in range(mesh.n_triangles) if shared[k].sum() == 2)
    corners = mesh.vertices_m[mesh.triangles[across]]
    a, b, third = *corners[shared[across]], corners[~shared[across]][0]
    axis, out = (b - a) / np.linalg.norm(b - a), np.cross(b - a, third - a)
    out /= np.linalg.norm(out)
    share = 1e-6 * apart_um / np.linalg.norm(third - 0.5 * (a + b))
    jaws = system.geometry.tools
    jaws.present[0], jaws.waiting[0], jaws.radius[0, JAW_A:] = True, False, 1e-3
    jaws.segments[0, JAW_A:] = 0.5 * (a + b) + 1.5e-3 * out + 5e-3 * np.array([-axis, axis])
    system.clear()
    on_edge = 0.5 * np.isin(mesh.triangles[one], mesh.triangles[across])
    append_pairs(found(one, on_edge, JAW_A, out), system.geometry, system.rows)
    turned = np.cos(turned_rad) * out + np.sin(turned_rad) * np.cross(axis, out)
    pairs = found(across, (1.0 - share) * 0.5 * shared[across] + share * ~shared[across], segment, turned)
    pairs.gap_m[0] = -50e-6
    keep_approaching(pairs.address, system.address, corners - 50e-6 * out)
    assert pairs.count == is_kept


def test_a_look_that_finds_nothing_leaves_no_trace(monkeypatch):
    _, without = _jerked(monkeypatch, lambda look: False)
    monkeypatch.setattr("services.mechanics.simulation.second_look.TOLERANCE_M", np.inf)
    monkeypatch.setattr("services.mechanics.simulation.second_look.TOLERANCE_OF_WALL", np.inf)
    simulation, looked = _jerked(monkeypatch, lambda look: True)
    assert simulation.solver.second_look.looks > LEAD_STEPS
    for one, other in zip(without, looked, strict=True):
        assert np.array_equal(one, other)


def test_tools_whose_pairs_come_from_elsewhere_are_looked_at_too(monkeypatch):
    """Whoever sends no pairs at all lets the jaws into the wall, but for what the second look finds."""
    simulation, _ = _jerked(monkeypatch, lambda look: True, given_pairs=True)
    assert simulation.solver.second_look.met > 0
