"""Solves in which sweeps and Newton steps run in circles: wedged bodies, with more friction than leads anywhere."""

import numpy as np
import pytest

from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.problem import UNBOUNDED, ContactProblem
from trocar.services.mechanics.contact.rows import KEPT, ContactRows
from trocar.services.mechanics.contact.solver import MOTION_TOLERANCE_M, solve_contacts
from trocar.services.mechanics.contact.stages import write_results
from trocar.services.mechanics.contact.writer import append_row

TOLERANCE_N = 1e-8
AT_ONCE = 6
"""Sweeps by which a solve may exceed its work: what is not asked for beforehand."""


def bounding_pressure_n(rows):
    """Return the pressures that bound friction: the present ones, or those with which it was found and kept."""
    given = rows.pressure_n
    return np.where(given <= KEPT, KEPT - given, np.where(given >= 0.0, given, rows.force_n[:, 0]))


class Wedged:
    """A random body of a few soft and many stiff modes, pressed everywhere, and its solution."""

    def __init__(self, seed, k, softness, mu, begun_n=None, most_sweeps=None, *, cycles=False):
        rng = np.random.default_rng(seed)
        J = rng.standard_normal((3 * k, len(softness))) * softness
        self.W = 1e-2 / len(softness) * (J @ J.T) + 1e-6 * np.eye(3 * k)
        self.free = 1e-4 * rng.standard_normal(3 * k)
        self.free[::3] -= 2e-4
        self.rows, self.slides = ContactRows.zeros(c=k), np.zeros(k, np.bool_)
        for _ in range(k):
            append_row(self.rows, number_of("unilateral"), 0)
        self.rows.friction[:] = mu
        problem = ContactProblem.of(self.rows)
        problem.free[:] = self.free
        if begun_n is not None:
            self.rows.force_n[:] = begun_n
        problem.products_left = UNBOUNDED if most_sweeps is None else float(most_sweeps * k * k)
        problem.cycles, allowed = cycles, problem.products_left
        self.sweeps = solve_contacts(problem, self.W, (30, TOLERANCE_N))
        self.work_sweeps = (allowed - problem.products_left) / (k * k)
        self.cycles = problem.cycles
        self.took_turns = bool((self.rows.pressure_n <= KEPT).any())
        write_results(self.rows, self.slides, np.zeros_like(self.rows.force_n))
        self.force, self.motion = self.rows.force_n, problem.motion.reshape(-1, 3)

    def check_law(self, mu):
        """Forces within their laws, surfaces that are pressed and do not overlap, friction that drives nothing."""
        force, motion = self.force, self.motion
        assert np.allclose(motion.ravel(), self.W @ force.ravel() + self.free, atol=1e-13)
        assert force[:, 0].min() >= 0.0
        assert motion[:, 0].min() > -MOTION_TOLERANCE_M
        assert np.abs(motion[force[:, 0] > 0.0, 0]).max() < MOTION_TOLERANCE_M
        rubs = np.hypot(force[:, 1], force[:, 2])
        assert np.all(rubs <= mu * bounding_pressure_n(self.rows) * (1.0 + 1e-9))
        assert np.sum(force[:, 1:] * motion[:, 1:]) <= MOTION_TOLERANCE_M * rubs.sum()


WIDE, NARROW = (50, np.geomspace(1.0, 0.03, 80)), (30, np.geomspace(1.0, 0.02, 60))
SMALL = 16, np.geomspace(1.0, 0.02, 20)


@pytest.mark.parametrize("mu", [0.3, 1.0, 2.0])
@pytest.mark.parametrize("shape", [WIDE, NARROW, SMALL])
def test_what_does_not_end_by_coulombs_law_ends_with_friction_and_without_overlap(shape, mu):
    """Up to millimetres were left, of a tenth of one, when such solves were broken off after a hundred sweeps."""
    every = [Wedged(seed, *shape, mu) for seed in range(10)]
    cycled = [each for each in every if each.took_turns]
    for each in cycled:
        each.check_law(mu)
        assert np.hypot(each.force[:, 1], each.force[:, 2]).sum() > 0.05 * each.force[:, 0].sum()
    assert mu < 1.0 or cycled


def test_friction_of_a_solve_that_cycles_is_nearly_that_of_the_forces_it_began_with():
    """A hand that holds still felt 0.7 N in a tick when all friction was dropped."""
    for seed in range(10):
        first = Wedged(seed, *NARROW, 1.0)
        again = Wedged(seed, *NARROW, 1.0, first.force.copy())
        if first.took_turns and again.took_turns:
            again.check_law(1.0)
            rubs = [np.hypot(each.force[:, 1], each.force[:, 2]).sum() for each in (first, again)]
            assert rubs[1] > 0.7 * rubs[0]


def test_a_solve_after_one_that_cycled_in_the_same_part_takes_turns_at_once():
    """Recovery is limited by a second solve and a third, and prices call for more: each cycled anew for 100 sweeps."""
    n_cycled = 0
    for seed in range(10):
        first = Wedged(seed, *WIDE, 1.0)
        assert first.cycles == first.took_turns
        if first.took_turns:
            again, n_cycled = Wedged(seed, *WIDE, 1.0, first.force.copy(), cycles=True), n_cycled + 1
            again.check_law(1.0)
            assert again.work_sweeps < 0.6 * first.work_sweeps
    assert n_cycled > 0


MANY = 150, np.geomspace(1.0, 0.03, 160)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_many_contacts_with_much_friction_end_too(seed):
    """Half a second went by in each of these, in one tick."""
    solved = Wedged(seed, *MANY, 2.0)
    assert solved.took_turns
    solved.check_law(2.0)


@pytest.mark.parametrize("most_sweeps", [0, 1, 3, 10, 30, 100, 300])
@pytest.mark.parametrize("shape", [SMALL, WIDE, MANY])
def test_a_solve_that_is_cut_short_takes_no_more_work_with_forces_in_their_laws_that_do_none(shape, most_sweeps):
    """One of a hundred rows took twice the work that a whole tick may, whatever was left of that."""
    for seed in range(3):
        solved = Wedged(seed, *shape, 1.0, most_sweeps=most_sweeps)
        force, motion = solved.force, solved.motion
        assert solved.work_sweeps <= most_sweeps + AT_ONCE
        assert np.allclose(motion.ravel(), solved.W @ force.ravel() + solved.free, atol=1e-13)
        assert force[:, 0].min() >= 0.0
        assert np.all(np.hypot(force[:, 1], force[:, 2]) <= bounding_pressure_n(solved.rows) * (1.0 + 1e-9))
        assert np.sum(force * motion) <= MOTION_TOLERANCE_M * np.abs(force).sum()


def test_more_work_leaves_less_overlap():
    deepest_m = [-Wedged(0, *MANY, 0.3, most_sweeps=most).motion[:, 0].min() for most in (10, 30, 100)]
    assert deepest_m[0] > deepest_m[1] > deepest_m[2]
    assert deepest_m[2] < MOTION_TOLERANCE_M
