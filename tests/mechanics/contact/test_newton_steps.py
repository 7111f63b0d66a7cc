"""Where Gauss-Seidel creeps: points that something stiff ties together, held, sticking or sliding."""

import numpy as np
import pytest

from services.mechanics.contact.laws import number_of
from services.mechanics.contact.laws.law import ContactProblem
from services.mechanics.contact.solver import SolverScratch, solve_contacts

UNILATERAL, HOLD = number_of("unilateral"), number_of("hold")
TIED = 1.0 - 1e-4


def tied_pair(laws, friction, force_limit_n, free):
    """Two blocks on one stiff body: a sweep takes a ten-thousandth off what their sum lacks."""
    W = 1e-2 * np.kron(np.array([[1.0, TIED], [TIED, 1.0]]), np.eye(3)) + 1e-6 * np.eye(6)
    motion, force = np.array(free, float), np.zeros(6)
    limits = np.array(friction, float), np.array(force_limit_n, float)
    scratch = SolverScratch.allocate(6)
    problem = ContactProblem(W, motion, force, np.array(laws, np.int8), *limits, scratch.change)
    sweeps = solve_contacts(problem, (200, 1e-10), scratch)
    return W, motion, force, sweeps


def test_tied_holds_are_solved_in_a_few_sweeps():
    free = [1e-4, 2e-4, -1e-4, 1.5e-4, 2e-4, 1e-4]
    W, motion, force, sweeps = tied_pair([HOLD, HOLD], [0, 0], [1e3, 1e3], free)
    assert sweeps <= 4
    assert np.allclose(force, np.linalg.solve(W, -np.array(free)), rtol=1e-6)
    assert np.abs(motion).max() < 1e-10


@pytest.mark.parametrize("limit", [0.5, 2.0, 5.0])
def test_a_slipping_hold_beside_one_that_holds(limit):
    _, motion, force, sweeps = tied_pair([HOLD, HOLD], [0, 0], [limit, 1e3], [3e-2, 2e-2, -1e-2, 4e-2, 2e-2, 1e-2])
    assert sweeps <= 25
    assert np.linalg.norm(force[:3]) == pytest.approx(limit, rel=1e-8)
    assert np.abs(motion[3:]).max() < 1e-9
    assert np.allclose(np.cross(motion[:3], force[:3]), 0.0, atol=1e-9)
    assert motion[:3] @ force[:3] < 0.0


def test_a_sliding_contact_beside_a_hold():
    free = [-1e-2, 3e-2, 1e-2, 2e-3, -1e-3, 1e-3]
    _, motion, force, sweeps = tied_pair([UNILATERAL, HOLD], [0.3, 0], [0, 1e7], free)
    assert sweeps <= 25
    assert force[0] > 0.0
    assert abs(motion[0]) < 1e-9
    assert np.hypot(force[1], force[2]) == pytest.approx(0.3 * force[0], rel=1e-8)
    assert abs(motion[1] * force[2] - motion[2] * force[1]) < 1e-9
    assert motion[1] * force[1] + motion[2] * force[2] < 0.0
    assert np.abs(motion[3:]).max() < 1e-9
