"""What jaws hold a catheter with: both points together by 2 mu N, no more, no less, at any step and speed."""

from dataclasses import replace

import numpy as np
import pytest

from tests.by_day import by_day
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT
from trocar.services.mechanics.contact.laws import GRIP_SOFTNESS_M_N
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation, step_solver
from trocar.studies.grip_energy import stored_in_grips
from trocar.studies.judge.overlaps import OverlapJudge

LIMIT_N = 0.05
BOTH_N = 2.0 * LIMIT_N
HELD_AT = 15
BEYOND_J_M = 12e-3
WAY_M = 1.5e-3


@pytest.fixture
def gripping(with_effects, small_duct):
    """Tool 1 holds the catheter at two points by friction of 50 mN each; and where J is."""
    scene = with_effects(grasp_slip={})
    scene = replace(scene, catheter=replace(scene.catheter, anchor="clamped"))
    simulation, tools = Simulation(scene, small_duct), ToolInputs()
    tools.present[0] = False
    held_at = simulation.catheter.state.position_m[HELD_AT].copy()
    shaft = held_at - simulation.tools.port_m[1]
    at = held_at - BEYOND_J_M * shaft / np.linalg.norm(shaft)
    tools.position_m[1], tools.roll_rad[1], tools.jaw_angle_rad[1] = at, 0.5 * np.pi, 0.31
    tools.holds = [
        GraspHold(number, 1, CATHETER_SEGMENT, HELD_AT, np.array([1.0 - s, s, 0.0]), LIMIT_N, 0.31)
        for number, s in ((3, 0.0), (5, 0.5))
    ]
    simulation.step(tools)
    return simulation, tools, at


def along_n(simulation):
    """Sum of what both points bear along the catheter, against its tip."""
    return -float(simulation.contacts.force_n[list(simulation.holds.rows), 1].sum())


def slips_m(simulation):
    return simulation.holds.arrays.slipped_m[: len(simulation.holds.active)].copy()


def give_of(simulation, at):
    """By how much the grip goes further than J, and how many m/N it gives: coupling, catheter and both points."""
    arm_m = np.linalg.norm(at - simulation.tools.port_m[1])
    lever = (arm_m + BEYOND_J_M) / arm_m
    catheter, tool = simulation.scene.catheter, simulation.scene.forceps[1]
    section_m2 = 0.25 * np.pi * (catheter.outer_diameter_m**2 - catheter.inner_diameter_m**2)
    from_clamp_m = HELD_AT / catheter.n_segments * catheter.length_m
    rod_m_n = from_clamp_m / (catheter.youngs_modulus_pa * section_m2)
    return lever, lever**2 / tool.coupling_stiffness_n_m + rod_m_n + 0.5 * GRIP_SOFTNESS_M_N


def pull(simulation, tools, at, way_m):
    """Move the hand to so far from J along the catheter, away from where that is clamped."""
    tools.position_m[1] = at - np.array([way_m, 0.0, 0.0])


@pytest.mark.parametrize(
    ("speed_m_s", "dt_s"),
    by_day(
        [(1e-3, 1e-3), (10e-3, 0.25e-3), (50e-3, 0.1e-3)],
        [(1e-3, 0.25e-3), (1e-3, 0.1e-3), (10e-3, 1e-3), (10e-3, 0.1e-3), (50e-3, 1e-3), (50e-3, 0.25e-3)],
    ),
)
def test_a_grip_breaks_away_at_twice_mu_n_at_any_step_and_speed(gripping, speed_m_s, dt_s):
    """Half of that before: the second point was guided only, and bore nothing along the catheter."""
    simulation, tools, at = gripping
    sliding_n = []
    for tick in range(1, round(1.5e-3 / (speed_m_s * dt_s)) + 1):
        pull(simulation, tools, at, speed_m_s * dt_s * tick)
        before_m = slips_m(simulation)
        simulation.step(tools, dt_s)
        force_n = along_n(simulation)
        assert force_n <= BOTH_N * (1.0 + 1e-9)
        if (slips_m(simulation) - before_m).max() > 0.1 * speed_m_s * dt_s:
            sliding_n.append(force_n)
    assert min(sliding_n) > 0.9999 * BOTH_N
    lever, give_m_n = give_of(simulation, at)
    assert slips_m(simulation) == pytest.approx(lever * WAY_M - give_m_n * BOTH_N, abs=6e-6)


@pytest.mark.parametrize("dt_s", by_day([1e-3, 0.25e-3], [0.1e-3]))
def test_a_grip_that_bears_less_does_not_creep(gripping, dt_s):
    simulation, tools, at = gripping
    lever, give_m_n = give_of(simulation, at)
    for way_m in np.linspace(0.0, 0.9 * BOTH_N * give_m_n / lever, 200):
        pull(simulation, tools, at, way_m)
        simulation.step(tools, dt_s)
    for _ in range(round(0.3 / dt_s)):
        simulation.step(tools, dt_s)
    held_n, slipped_m = along_n(simulation), slips_m(simulation)
    along_m = simulation.catheter.state.position_m[:, 0].copy()
    assert held_n == pytest.approx(0.9 * BOTH_N, rel=0.01)
    for _ in range(round(1.0 / dt_s)):
        simulation.step(tools, dt_s)
    # What moves the hand's end of the grip by less than the nanometre below.
    assert along_n(simulation) == pytest.approx(held_n, abs=1e-9 / give_m_n)
    assert np.all(slips_m(simulation) == slipped_m)
    assert np.abs(simulation.catheter.state.position_m[:, 0] - along_m).max() < 1e-9


@pytest.mark.parametrize("aside", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-0.5, 0.6, 0.6)])
def test_jaws_that_drag_a_catheter_hard_stay_out_of_it(gripping, aside):
    """Before, they did not collide with what they held: it went up to 2 mm into them."""
    simulation, tools, at = gripping
    judge, felt_n = OverlapJudge(simulation), 0.0
    for tick in range(400):
        tools.position_m[1] = at + 0.2e-3 * min(tick, 150) * np.array(aside)
        simulation.step(tools)
        judge.look()
        felt_n = max(felt_n, float(np.linalg.norm(simulation.tool_results.force_n[1])))
    assert felt_n > 0.1
    assert judge.deepest["tool in catheter"] < 0.1e-3


def test_a_hold_stores_what_it_bears_where_a_solve_is_cut_short(gripping, monkeypatch):
    """Its spring had stored a slip that no force opposed: 0.4 J in a tick for 5 mJ of the hands."""
    simulation, tools, at = gripping
    cut, rows = 0, simulation.contacts
    monkeypatch.setattr(step_solver, "MOST_PRODUCTS", step_solver.PART_PRODUCTS)
    for tick in range(30):
        pull(simulation, tools, at, 0.1e-3 * tick)
        simulation.step(tools)
        if simulation.share > 0.0 and simulation.system.is_cut:
            held = list(simulation.holds.rows)
            borne_j = 0.5 * float(np.sum(rows.softness_m_n[held] * rows.force_n[held] ** 2))
            assert stored_in_grips(simulation).total_j - simulation.seal.stored_j == pytest.approx(borne_j, rel=1e-9)
            cut += 1
    assert cut
