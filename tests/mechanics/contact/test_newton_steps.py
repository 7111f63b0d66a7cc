"""Where Gauss-Seidel creeps: points that something stiff ties together, held, sticking or sliding."""

import numpy as np
import pytest

from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.solver import solve_contacts
from trocar.services.mechanics.contact.writer import append_row

UNILATERAL, GRIP = number_of("unilateral"), number_of("grip")
TIED = 1.0 - 1e-4


def tied_pair(laws, friction, force_limit_n, free):
    """Two blocks on one stiff body: a sweep takes a ten-thousandth off what their sum lacks."""
    W = 1e-2 * np.kron(np.array([[1.0, TIED], [TIED, 1.0]]), np.eye(3)) + 1e-6 * np.eye(6)
    rows = ContactRows.zeros(c=2)
    for law in laws:
        append_row(rows, law, 0)
    rows.friction[:], rows.force_limit_n[:] = friction, force_limit_n
    problem = ContactProblem.of(rows)
    problem.free[:] = free
    sweeps = solve_contacts(problem, W, (200, 1e-10))
    return W, problem.motion, rows.force_n.ravel(), sweeps


def test_tied_holds_are_solved_in_a_few_sweeps():
    free = [1e-4, 2e-4, -1e-4, 1.5e-4, 2e-4, 1e-4]
    W, motion, force, sweeps = tied_pair([GRIP, GRIP], [0, 0], [1e3, 1e3], free)
    assert sweeps <= 4
    assert np.allclose(force, np.linalg.solve(W, -np.array(free)), rtol=1e-6)
    assert np.abs(motion).max() < 1e-10


@pytest.mark.parametrize("limit", [0.5, 2.0, 5.0])
def test_a_grip_slips_along_the_jaws_only_however_hard_it_is_pressed_on_one_of_them(limit):
    free = [30e-2, 2e-2, -1e-2, 40e-2, 2e-2, 1e-2]
    W, motion, force, sweeps = tied_pair([GRIP, GRIP], [0, 0], [limit, 1e3], free)
    assert sweeps <= 25
    assert np.allclose(motion, free + W @ force)
    assert np.hypot(*force[1:3]) == pytest.approx(limit, rel=1e-8)
    assert abs(force[0]) > 5.0 * limit
    assert abs(motion[0]) < 1e-9
    assert np.abs(motion[3:]).max() < 1e-9
    assert motion[1] * force[2] == pytest.approx(motion[2] * force[1], rel=1e-6)
    assert motion[1:3] @ force[1:3] < 0.0


def test_a_grip_that_squeezes_no_more_bears_nothing():
    _, motion, force, _ = tied_pair([GRIP, GRIP], [0, 0], [0.0, 0.0], [3e-2, 2e-2, -1e-2, 4e-2, 2e-2, 1e-2])
    assert not force.any()
    assert motion[0] == 3e-2


def test_a_sliding_contact_beside_a_hold():
    free = [-1e-2, 3e-2, 1e-2, 2e-3, -1e-3, 1e-3]
    _, motion, force, sweeps = tied_pair([UNILATERAL, GRIP], [0.3, 0], [0, 1e7], free)
    assert sweeps <= 25
    assert force[0] > 0.0
    assert abs(motion[0]) < 1e-9
    assert np.hypot(force[1], force[2]) == pytest.approx(0.3 * force[0], rel=1e-8)
    assert abs(motion[1] * force[2] - motion[2] * force[1]) < 1e-9
    assert motion[1] * force[1] + motion[2] * force[2] < 0.0
    assert np.abs(motion[3:]).max() < 1e-9
