"""Solves in which sweeps and Newton steps run in circles: wedged bodies, with more friction than leads anywhere."""

import numpy as np
import pytest

from trocar.services.mechanics.contact.active_set import MAX_COST
from trocar.services.mechanics.contact.laws import number_of
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.rows import ContactRows
from trocar.services.mechanics.contact.solver import MAX_SWEEPS, solve_contacts
from trocar.services.mechanics.contact.stages import write_results
from trocar.services.mechanics.contact.writer import append_row

TOLERANCE_N, TOLERANCE_M = 1e-8, 1e-9


class Wedged:
    """A random body of a few soft and many stiff modes, pressed everywhere, and its solution."""

    def __init__(self, seed, k, softness, mu, tolerated_m=0.0):
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
        problem.free[:], problem.tolerated_m = self.free, tolerated_m
        self.sweeps = solve_contacts(problem, self.W, (30, TOLERANCE_N))
        write_results(self.rows, self.slides, np.zeros_like(self.rows.force_n))
        self.force, self.motion = self.rows.force_n, problem.motion.reshape(-1, 3)

    def check_law(self, most_mu):
        """Signorini's and Coulomb's laws, with the coefficients that the rows have now."""
        force, motion, mu = self.force, self.motion, self.rows.friction
        assert np.allclose(motion.ravel(), self.W @ force.ravel() + self.free, atol=1e-13)
        assert force[:, 0].min() >= 0.0
        assert motion[:, 0].min() > -TOLERANCE_M
        assert np.abs(motion[force[:, 0] > 0.0, 0]).max() < TOLERANCE_M
        rubs = np.hypot(force[:, 1], force[:, 2])
        assert np.all(rubs <= most_mu * force[:, 0] * (1.0 + 1e-9))
        sliding = self.slides & (rubs > 0.0)
        assert np.allclose(rubs[sliding], (mu * force[:, 0])[sliding], rtol=1e-8)
        slip = np.hypot(motion[:, 1], motion[:, 2])
        assert slip[~self.slides & (force[:, 0] > 0.0)].max(initial=0.0) < TOLERANCE_M
        against = force[:, 1] * motion[:, 1] + force[:, 2] * motion[:, 2]
        assert np.all(np.abs(against + rubs * slip)[sliding] < TOLERANCE_M * rubs[sliding])


WIDE, NARROW = (50, np.geomspace(1.0, 0.03, 80)), (30, np.geomspace(1.0, 0.02, 60))
SMALL = 16, np.geomspace(1.0, 0.02, 20)


@pytest.mark.parametrize("mu", [0.3, 1.0, 2.0])
@pytest.mark.parametrize("shape", [WIDE, NARROW, SMALL])
def test_what_does_not_end_with_friction_ends_without_and_nothing_overlaps(shape, mu):
    """Up to millimetres were left, of a tenth of one, when such solves were broken off after a hundred sweeps."""
    solved = [each for seed in range(10) if (each := Wedged(seed, *shape, mu)).sweeps > MAX_SWEEPS]
    for each in solved:
        each.check_law(mu)
    assert mu < 1.0 or any(np.all(each.rows.friction == 0.0) for each in solved)


@pytest.mark.parametrize(
    ("shape", "most"), [((3, np.geomspace(1.0, 0.003, 6)), 32), ((5, np.geomspace(1.0, 0.003, 10)), 37)]
)
def test_fewer_wedged_bodies_lose_friction_than_by_steps_of_coulombs_law_alone(shape, most):
    """Of 400, 39 and 40 did when all Newton steps were those of Coulomb's law, which open what sweeps close."""
    solved = [Wedged(seed, *shape, mu) for seed in range(200) for mu in (0.6, 1.0)]
    assert sum(bool(np.all(each.rows.friction == 0.0)) for each in solved) <= most


def test_a_cycle_within_the_tolerated_overlap_keeps_friction():
    """The forces are those of the cycle at which a sweep moved surfaces least."""
    kept = 0
    for seed in range(40):
        without = Wedged(seed, *NARROW, 1.0)
        if np.all(without.rows.friction == 0.0):
            each = Wedged(seed, *NARROW, 1.0, tolerated_m=30e-6)
            if np.all(each.rows.friction == 1.0):
                kept += 1
                rubs = np.hypot(each.force[:, 1], each.force[:, 2])
                assert each.motion[:, 0].min() > -30e-6
                assert np.all(rubs <= each.force[:, 0] * (1.0 + 1e-9))
                assert np.allclose(each.motion.ravel(), each.W @ each.force.ravel() + each.free, atol=1e-13)
    assert kept > 0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_many_contacts_with_much_friction_end_without_overlap_after_a_few_changes_of_the_active_set(seed):
    """Half a second went by in each of these, in one tick."""
    k = 150
    solved = Wedged(seed, k, np.geomspace(1.0, 0.03, 160), 2.0)
    assert MAX_SWEEPS < solved.sweeps < MAX_SWEEPS + 5 * (MAX_COST + k)
    solved.check_law(2.0)
