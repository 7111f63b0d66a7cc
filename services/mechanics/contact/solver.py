"""Projected block Gauss-Seidel (PGS) with Newton steps, on a dense Delassus operator."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact import laws
from services.mechanics.contact.laws.law import ContactProblem, Unknowns
from services.mechanics.contact.newton import add_step, list_unknowns, newton_step

# Times the tolerance: a first sweep that changes less is followed by another, which costs less than a Newton step.
NEARLY_THERE = 100.0


class SolverScratch(NamedTuple):
    """Work space of a solve with at most m rows, on a duct of r modes."""

    unknowns: Unknowns
    force: FloatArray  # (m,)
    free: FloatArray  # (m,)
    change: FloatArray  # (3,)
    modes: FloatArray  # (m * r,)

    @classmethod
    def allocate(cls, n_rows: int, n_modes: int = 0) -> SolverScratch:
        """Return work space for ``n_rows`` rows, assembled from ``n_modes`` modes."""
        force, free, change = np.zeros(n_rows), np.zeros(n_rows), np.zeros(3)
        return cls(Unknowns.allocate(n_rows), force, free, change, np.zeros(n_rows * n_modes))


@kernel
def solve_contacts(problem: ContactProblem, effort: tuple[int, float], scratch: SolverScratch) -> int:
    r"""Solve the contact problem of one step in place and return the number of sweeps.

    With the motion :math:`u = W f + u_{free}` each block of three rows (normal, tangent, tangent) obeys the law of its
    contact.

    Numerically: a sweep of block Gauss-Seidel solves each block exactly with the others fixed, normal first, then
    tangent in its cone. That finds who is pressed and who sticks, but converges slowly where a stiff catheter ties
    contacts together; so a Newton step solves for all that is closed together, as PGS with subspace minimisation does
    (Silcowitz-Hansen, Niebe and Erleben, 2010). It is kept if it and the next sweep lower the potential
    :math:`\tfrac12 f^T W f + f^T u_{free}`; how much a sweep changes would tell nothing, for sweeps that creep change
    little. After a step that was not kept twice as many sweeps as before pass until the next.
    The cost is bounded by the number of sweeps. Forces are inside their cones, converged or not.

    Parameters
    ----------
    problem : ContactProblem
        In: ``motion`` without contact forces, ``force`` to start from. Out: the solution.
    effort : (iterations, tolerance_n)
        Most sweeps, and the change of any force component in a sweep at which to stop.
    scratch : SolverScratch
    """
    iterations, tolerance_n = effort
    _copy(problem.motion, scratch.free)
    _update_motion(problem, scratch.free)
    sweeps, patience, last_n = 0, 1, 0.0
    due = patience
    while sweeps < iterations:
        change_n = _sweep(problem)
        sweeps += 1
        if change_n <= tolerance_n or sweeps == iterations:
            return sweeps
        # Falling as before, the next change would be within the tolerance: a sweep is cheaper than a Newton step.
        ends_next = change_n * change_n <= tolerance_n * last_n
        last_n = change_n
        if sweeps < due or ends_next or (sweeps == 1 and change_n <= NEARLY_THERE * tolerance_n):
            continue
        before = _potential(problem, scratch.free)
        if _try_newton_step(problem, scratch):
            sweeps += 1
            if _sweep(problem) <= tolerance_n:
                return sweeps
        patience = 1 if _potential(problem, scratch.free) < before else 2 * patience
        if patience > 1:
            _copy(scratch.force, problem.force)
            _update_motion(problem, scratch.free)
        due, last_n = sweeps + patience, 0.0
    return sweeps


@kernel
def _potential(problem: ContactProblem, free: FloatArray) -> float:
    total = 0.0
    for row in range(problem.force.shape[0]):
        total += 0.5 * problem.force[row] * (problem.motion[row] + free[row])
    return total


@kernel
def _sweep(problem: ContactProblem) -> float:
    """Relax every contact once and return the largest change of a force component."""
    largest, change = 0.0, problem.change
    for block in range(problem.law.shape[0]):
        laws.relax(problem.law[block], problem, block)
        largest = max(largest, abs(change[0]), abs(change[1]), abs(change[2]))
    return largest


@kernel
def _try_newton_step(problem: ContactProblem, scratch: SolverScratch) -> bool:
    """Take a Newton step; the forces before are kept in ``scratch.force``."""
    _copy(problem.force, scratch.force)
    n = list_unknowns(problem, scratch.unknowns)
    if n == 0 or not newton_step(problem, scratch.unknowns, n):
        return False
    add_step(problem, scratch.unknowns, n)
    _update_motion(problem, scratch.free)
    return True


@kernel
def _copy(source: FloatArray, target: FloatArray) -> None:
    """Copy as many items as the shorter has."""
    for i in range(min(source.shape[0], target.shape[0])):
        target[i] = source[i]


@kernel
def _update_motion(problem: ContactProblem, free: FloatArray) -> None:
    """Write the motion u = W f + u_free."""
    W, motion = problem.W, problem.motion
    for row in range(motion.shape[0]):
        motion[row] = free[row]
    for row in range(motion.shape[0]):
        force = problem.force[row]
        if force != 0.0:
            for column in range(motion.shape[0]):
                motion[column] += W[row, column] * force
