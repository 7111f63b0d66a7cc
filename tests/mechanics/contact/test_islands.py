"""Islands of contacts: found in W as by graph search, and left out of a Newton step once a sweep has solved them."""

import numpy as np
from scipy.sparse.csgraph import connected_components

from trocar.services.mechanics.contact.islands import find_islands, note_settled
from trocar.services.mechanics.contact.newton import list_unknowns
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.solver import solve_contacts
from trocar.services.mechanics.contact.sweeps import sweep, update_motion

TOLERANCE_N = 1e-8


def coupled(k, pairs, rng):
    """A positive definite W (3 k, 3 k) with blocks at these pairs, one of them of a single number."""
    W = np.zeros((3 * k, 3 * k))
    for number, (a, b) in enumerate(pairs):
        block = rng.normal(size=(3, 3)) if number else np.diag([0.0, 0.0, -1.0])
        W[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += block
        W[3 * b : 3 * b + 3, 3 * a : 3 * a + 3] += block.T
    return W + np.eye(3 * k) * (1.1 * np.abs(W).sum(axis=0).max() + 1.0)


def problem_of(k, rng):
    """Contacts without friction, pressed by their free motion."""
    rows = ContactRows.zeros(c=k)
    rows.n_contacts, rows.softness_m_n[:] = k, 1e-3
    problem = ContactProblem.of(rows)
    problem.free[: 3 * k] = -rng.uniform(1.0, 2.0, 3 * k)
    return problem


def test_islands_are_the_connected_components_of_the_blocks():
    for seed in range(30):
        rng = np.random.default_rng(seed)
        k = int(rng.integers(2, 14))
        pairs = [tuple(rng.choice(k, 2, replace=False)) for _ in range(int(rng.integers(0, k)))]
        problem, W = problem_of(k, rng), coupled(k, pairs, rng)
        find_islands(problem, W)
        graph = np.abs(W).reshape(k, 3, k, 3).sum(axis=(1, 3)) > 0.0
        _, expected = connected_components(graph, directed=False)
        assert ((problem.island[:k, None] == problem.island[:k]) == (expected[:, None] == expected)).all()


def test_a_newton_step_is_of_the_islands_that_the_last_sweep_has_not_solved():
    """The first two contacts are solved, then the other two are pushed."""
    rng = np.random.default_rng(1)
    W, problem = coupled(4, [(0, 1), (2, 3)], rng), problem_of(4, rng)
    find_islands(problem, W)
    solve_contacts(problem, W, (200, TOLERANCE_N))
    problem.free[6:] -= 0.5
    update_motion(problem, W)
    sweep(problem, W)
    note_settled(problem, TOLERANCE_N)
    n = list_unknowns(problem)
    assert n > 0
    assert set(problem.block[:n]) == {2, 3}
