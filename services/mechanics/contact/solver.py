"""Projected block Gauss-Seidel for contact and Coulomb friction on a dense contact-space compliance."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from services.mechanics.arrays import BoolArray, ByteArray, FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.active_set import (
    FILM,
    HOLD,
    ON_THE_LIMIT,
    UNILATERAL,
    Unknowns,
    add_step,
    list_unknowns,
    newton_step,
)
from services.mechanics.contact.ball import bounded_2, bounded_3

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
def solve_contacts(
    W: FloatArray,
    motion: FloatArray,
    kind: ByteArray,
    limit: FloatArray,
    force: FloatArray,
    effort: tuple[int, float],
    scratch: SolverScratch,
) -> int:
    r"""Solve the contact problem of one step in place and return the number of sweeps.

    With the motion :math:`u = W f + u_{free}` each block of three rows (normal, tangent, tangent) obeys

    - unilateral: :math:`0 \le u_n \perp f_n \ge 0` and Coulomb's law with maximal dissipation,
      :math:`|f_t| \le \mu f_n`, sliding against :math:`f_t`;
    - hold: :math:`u = 0` while :math:`|f| \le limit`, else slip against :math:`f`; a film is the same with a softness.

    Numerically: a sweep of block Gauss-Seidel solves each block exactly with the others fixed, normal first, then
    tangent in its cone. That finds who is pressed and who sticks, but converges slowly where a stiff catheter ties
    contacts together; so a Newton step solves for all that is closed together, as PGS with subspace minimisation does
    (Silcowitz-Hansen, Niebe and Erleben, 2010). It is kept if it and the next sweep lower the potential
    :math:`\tfrac12 f^T W f + f^T u_{free}`; how much a sweep changes would tell nothing, for sweeps that creep change
    little. After a step that was not kept twice as many sweeps as before pass until the next.
    The cost is bounded by the number of sweeps. Forces are inside their cones, converged or not.

    Parameters
    ----------
    W : (m, m) float64
        Contact-space compliance in m/N, symmetric positive, m = 3 k.
    motion : (m,) float64
        In: gap (normal rows) and slip (tangential rows) at the end of the step without contact forces, in m.
        Out: the same with them.
    kind : (k,) int8
        `UNILATERAL`, `HOLD` or `FILM`.
    limit : (k,) float64
        Coefficient of friction, or the largest force of a hold in N; zero means frictionless, or no hold.
    force : (m,) float64
        Start values in, solution out.
    effort : (iterations, tolerance_n)
        Most sweeps, and the change of any force component in a sweep at which to stop.
    scratch : SolverScratch
    """
    iterations, tolerance_n = effort
    _copy(motion, scratch.free)
    _update_motion(W, scratch.free, force, motion)
    sweeps, patience, last_n = 0, 1, 0.0
    due = patience
    while sweeps < iterations:
        change_n = _sweep(W, motion, kind, limit, force, scratch.change)
        sweeps += 1
        if change_n <= tolerance_n or sweeps == iterations:
            return sweeps
        # Falling as before, the next change would be within the tolerance: a sweep is cheaper than a Newton step.
        ends_next = change_n * change_n <= tolerance_n * last_n
        last_n = change_n
        if sweeps < due or ends_next or (sweeps == 1 and change_n <= NEARLY_THERE * tolerance_n):
            continue
        before = _potential(scratch.free, motion, force)
        if _try_newton_step(W, motion, kind, limit, force, scratch):
            sweeps += 1
            if _sweep(W, motion, kind, limit, force, scratch.change) <= tolerance_n:
                return sweeps
        patience = 1 if _potential(scratch.free, motion, force) < before else 2 * patience
        if patience > 1:
            _copy(scratch.force, force)
            _update_motion(W, scratch.free, force, motion)
        due, last_n = sweeps + patience, 0.0
    return sweeps


@kernel
def _potential(free: FloatArray, motion: FloatArray, force: FloatArray) -> float:
    total = 0.0
    for row in range(force.shape[0]):
        total += 0.5 * force[row] * (motion[row] + free[row])
    return total


@kernel
def _sweep(
    W: FloatArray, motion: FloatArray, kind: ByteArray, limit: FloatArray, force: FloatArray, change: FloatArray
) -> float:
    """Relax every block once and return the largest change of a force component."""
    largest = 0.0
    for block in range(kind.shape[0]):
        if kind[block] == UNILATERAL:
            _relax_unilateral(W, motion, limit[block], force, 3 * block, change)
        else:
            _relax_hold(W, motion, limit[block], force, 3 * block, change)
        largest = max(largest, abs(change[0]), abs(change[1]), abs(change[2]))
    return largest


@kernel
def _try_newton_step(
    W: FloatArray, motion: FloatArray, kind: ByteArray, limit: FloatArray, force: FloatArray, scratch: SolverScratch
) -> bool:
    """Take a Newton step; the forces before are kept in ``scratch.force``."""
    _copy(force, scratch.force)
    n = list_unknowns(motion, kind, limit, force, scratch.unknowns)
    if n == 0 or not newton_step(W, motion, scratch.unknowns, n):
        return False
    add_step(kind, limit, force, scratch.unknowns, n)
    _update_motion(W, scratch.free, force, motion)
    return True


@kernel
def _copy(source: FloatArray, target: FloatArray) -> None:
    """Copy as many items as the shorter has."""
    for i in range(min(source.shape[0], target.shape[0])):
        target[i] = source[i]


@kernel
def _update_motion(W: FloatArray, free: FloatArray, force: FloatArray, motion: FloatArray) -> None:
    for row in range(motion.shape[0]):
        motion[row] = free[row]
    for row in range(force.shape[0]):
        _add_row(motion, W, row, force[row])


@kernel
def _add_row(motion: FloatArray, W: FloatArray, row: int, change: float) -> None:
    """Keep ``motion`` up to date; an update along a row of the symmetric W vectorises, a dot would not."""
    if change != 0.0:
        for column in range(motion.shape[0]):
            motion[column] += W[row, column] * change


@kernel
def _relax_unilateral(
    W: FloatArray, motion: FloatArray, mu: float, force: FloatArray, row: int, change: FloatArray
) -> None:
    """Exact normal force for fixed friction, then exact friction for the new normal force."""
    normal = max(0.0, force[row] - motion[row] / W[row, row])
    change[0] = normal - force[row]
    force[row] = normal
    _add_row(motion, W, row, change[0])
    f_1, f_2 = 0.0, 0.0
    if mu * normal > 0.0:
        a, b, c = W[row + 1, row + 1], W[row + 1, row + 2], W[row + 2, row + 2]
        r_1 = motion[row + 1] - a * force[row + 1] - b * force[row + 2]
        r_2 = motion[row + 2] - b * force[row + 1] - c * force[row + 2]
        f_1, f_2 = bounded_2(a, b, c, r_1, r_2, mu * normal)
    change[1] = f_1 - force[row + 1]
    change[2] = f_2 - force[row + 2]
    force[row + 1] = f_1
    force[row + 2] = f_2
    _add_row(motion, W, row + 1, change[1])
    _add_row(motion, W, row + 2, change[2])


@kernel
def _relax_hold(
    W: FloatArray, motion: FloatArray, limit: float, force: FloatArray, row: int, change: FloatArray
) -> None:
    """No motion inside the ball of the largest force, slip against the force on its edge."""
    if limit <= 0.0:
        change[:] = 0.0
    else:
        f_0, f_1, f_2 = force[row], force[row + 1], force[row + 2]
        r_0 = motion[row] - W[row, row] * f_0 - W[row, row + 1] * f_1 - W[row, row + 2] * f_2
        r_1 = motion[row + 1] - W[row + 1, row] * f_0 - W[row + 1, row + 1] * f_1 - W[row + 1, row + 2] * f_2
        r_2 = motion[row + 2] - W[row + 2, row] * f_0 - W[row + 2, row + 1] * f_1 - W[row + 2, row + 2] * f_2
        bounded_3(W, row, (r_0, r_1, r_2), limit, change)
    for axis in range(3):
        change[axis] -= force[row + axis]
        force[row + axis] += change[axis]
        _add_row(motion, W, row + axis, change[axis])


@kernel
def mark_sliding(kind: ByteArray, limit: FloatArray, force: FloatArray, slides: BoolArray) -> None:
    """Write for each block (k,) whether its friction is on its limit, or its hold slips."""
    for block in range(kind.shape[0]):
        f_n, f_1, f_2 = force[3 * block], force[3 * block + 1], force[3 * block + 2]
        tangent = math.hypot(f_1, f_2)
        if kind[block] == UNILATERAL:
            slides[block] = f_n > 0.0 and tangent >= ON_THE_LIMIT * limit[block] * f_n
        else:
            slides[block] = math.hypot(f_n, tangent) >= ON_THE_LIMIT * limit[block]


__all__ = ["FILM", "HOLD", "ON_THE_LIMIT", "UNILATERAL", "SolverScratch", "mark_sliding", "solve_contacts"]
