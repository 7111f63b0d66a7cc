"""Newton steps through changes of the active set: descent, and the rest of a step against a system solved anew."""

import numpy as np
import pytest

from trocar.services.mechanics.contact.active_set import take_newton_steps
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.newton import list_unknowns, solve_newton_step
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.sweeps import sweep, update_motion
from trocar.services.mechanics.contact.writer import append_row

CUT = 1  # after the first sweep, steps are cut


def pressed_body(seed, k, mu):
    """A random body of soft and stiff modes, pressed everywhere, after the first sweep."""
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((3 * k, 60)) * np.geomspace(1.0, 0.03, 60)
    W = 2e-4 * (J @ J.T) + 1e-6 * np.eye(3 * k)
    rows = ContactRows.zeros(c=k)
    for _ in range(k):
        append_row(rows, number_of("unilateral"), 0)
    rows.friction[:] = mu
    problem = ContactProblem.of(rows)
    problem.free[:] = 1e-4 * rng.standard_normal(3 * k)
    problem.free[::3] -= 2e-4
    update_motion(problem, W)
    sweep(problem, W)
    return problem, W


def potential_j(problem, W):
    force = problem.rows.force_n.ravel()
    return 0.5 * force @ W @ force + force @ problem.free


@pytest.mark.parametrize("seed", range(10))
def test_without_friction_every_sequence_and_every_sweep_descends(seed):
    """The potential is convex then, and the solution its minimum: so solves end."""
    problem, W = pressed_body(seed, 20, 0.0)
    last_j = potential_j(problem, W)
    for _ in range(20):
        take_newton_steps(problem, W, 1e-12, CUT)
        stepped_j = potential_j(problem, W)
        assert stepped_j <= last_j + 1e-15
        change_n, _ = sweep(problem, W)
        last_j = potential_j(problem, W)
        assert last_j <= stepped_j + 1e-15
        if change_n < 1e-9:
            break
    assert change_n < 1e-9


@pytest.mark.parametrize("seed", range(10))
def test_contacts_left_pressed_have_the_forces_of_a_system_solved_anew(seed):
    """Some contacts open on the way; those left carry what they would without the others."""
    problem, W = pressed_body(seed, 30, 0.0)
    before = problem.rows.force_n[:, 0] > 0.0
    take_newton_steps(problem, W, 1e-12, CUT)
    force = problem.rows.force_n[:, 0]
    left = force > 0.0
    assert left.sum() < before.sum()
    expected = np.linalg.solve(W[::3, ::3][np.ix_(left, left)], -problem.free[::3][left])
    np.testing.assert_allclose(force[left], expected, rtol=1e-6)
    np.testing.assert_allclose(problem.motion, W @ problem.rows.force_n.ravel() + problem.free, atol=1e-15)


@pytest.mark.parametrize("mu", [0.05, 0.2])
def test_a_contact_that_slips_on_the_way_leaves_the_rest_to_the_one_that_sticks(mu):
    """Two coupled contacts dragged along one axis: the first slips at mu times its load, which has a closed form."""
    C, load_m, drag_m = np.array([[2e-3, 5e-4], [5e-4, 1e-3]]), np.array([4e-4, 3e-4]), 2e-4
    rows = ContactRows.zeros(c=2)
    for _ in range(2):
        append_row(rows, number_of("unilateral"), 0)
    rows.friction[:], rows.force_n[:, 0] = (mu, 10.0), 0.1
    problem = ContactProblem.of(rows)
    problem.free[:] = np.stack([-load_m, np.full(2, drag_m), np.zeros(2)], axis=1).ravel()
    W = np.kron(C, np.eye(3))
    update_motion(problem, W)
    take_newton_steps(problem, W, 1e-12, CUT)
    normal = np.linalg.solve(C, load_m)
    first = -mu * normal[0]
    second = -(drag_m + C[1, 0] * first) / C[1, 1]
    np.testing.assert_allclose(rows.force_n, [[normal[0], first, 0.0], [normal[1], second, 0.0]], rtol=1e-8, atol=1e-12)


def test_forces_stay_in_their_cones_where_contacts_slip_or_open_on_the_way():
    slipped = 0
    for seed in range(20):
        problem, W = pressed_body(seed, 12, 0.3)
        began = sticks(problem)
        take_newton_steps(problem, W, 1e-12, CUT)
        force = problem.rows.force_n
        assert force[:, 0].min() >= 0.0
        assert np.all(np.hypot(force[:, 1], force[:, 2]) <= 0.3 * force[:, 0] * (1.0 + 1e-9))
        slipped += (began & ~sticks(problem)).sum()
    assert slipped > 0


def sticks(problem):
    force = problem.rows.force_n
    return (force[:, 0] > 0.0) & (np.hypot(force[:, 1], force[:, 2]) < 0.3 * force[:, 0] * (1.0 - 1e-9))


def slope_j(problem, W):
    """Return the change of the potential along the full step, to first order."""
    n = list_unknowns(problem)
    assert solve_newton_step(problem, W, n)
    change = np.zeros_like(problem.rows.force_n)
    np.add.at(change, problem.block[:n], problem.column[:n] * problem.step[:n, None])
    return change.ravel() @ problem.motion


def test_the_potential_falls_along_a_step_where_a_pressure_bounds_friction_but_may_rise_by_coulombs_law():
    slopes = []
    for seed in range(40):
        problem, W = pressed_body(seed, 12, 2.0)
        coulomb_j = slope_j(problem, W)
        problem.rows.pressure_n[:] = problem.rows.force_n[:, 0]
        slopes.append((slope_j(problem, W), coulomb_j))
    assert max(given for given, _ in slopes) < 0.0 < max(coulomb for _, coulomb in slopes)


def test_a_seal_that_stops_just_below_its_limit_leaves_all_forces_finite():
    """A law without a disk counts as sliding there; as a contact on the edge of its disk it had no direction."""
    rows, limit_n = ContactRows.zeros(c=3), 0.5
    for law in ("unilateral", "seal", "unilateral"):
        append_row(rows, number_of(law), 0)
    rows.force_limit_n[1], rows.force_n[:, 0] = limit_n, (1.0, 0.0, 1.0)
    problem = ContactProblem.of(rows)
    W = np.eye(9)
    step = np.array([-2.0, limit_n / (0.5 * (1.0 + 1.5e-9)), 0.5])
    problem.free[::3] = -(rows.force_n[:, 0] + step)
    update_motion(problem, W)
    take_newton_steps(problem, W, 1e-12, CUT)
    np.testing.assert_allclose(rows.force_n[:, 0], [0.0, limit_n, 1.5], atol=1e-8)
