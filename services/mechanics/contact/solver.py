"""Projected block Gauss-Seidel (PGS) with Newton steps, on a dense Delassus operator."""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.contact.newton import (
    active_set_cost,
    add_step,
    copy_forces,
    has_small_residual,
    list_unknowns,
    newton_step,
    sweep,
    take_active_set_steps,
    update_motion,
)
from services.mechanics.contact.problem import ContactProblem

# If the first sweep changes forces by less than this multiple of the tolerance, another one follows instead of a Newton
# step, whose dense solve costs as much as one sweep for every two contacts.
NEAR = 100.0
# A solve goes beyond its allowed sweeps while a sweep moves a surface by more than this along its normal. Bodies would
# overlap by at least as much, because a contact relaxed early in a sweep does not see the changes after it. In a hard
# case one tick of fifty needs more than thirty sweeps; if such solves were cut short, the bodies would gain energy.
MOTION_TOLERANCE_M = 1e-6
# After so many, or Newton steps that cost as much, the solve counts as cycling. Coulomb's law has no potential, because
# the bound on friction changes with the normal force; without friction the solution is the minimum of a convex one.
MAX_SWEEPS = 150


@kernel
def solve_contacts(problem: ContactProblem, W: FloatArray, effort: tuple[int, float]) -> int:
    r"""Solve the contact problem of one step in place and return the number of sweeps.

    The relative motion of the contact points is :math:`u = W f + u_{free}`. Each contact is a block of three rows
    (normal, two tangents), whose force and motion obey the contact's law.

    - A block Gauss-Seidel sweep solves each block exactly with the others fixed: first the normal, then the tangents
      within the friction cone. Sweeps find the active set (which contacts are pressed, and which stick), but converge
      slowly where a stiff catheter couples contacts.
    - So a Newton step between sweeps solves for all active force components together, as in PGS with subspace
      minimisation (Silcowitz-Hansen, Niebe and Erleben, 2010). It is accepted if it and the next sweep lower the
      potential :math:`\tfrac12 f^T W f + f^T u_{free}` below the lowest of this solve. The change in a sweep is no such
      measure: it is small for slow convergence too. Otherwise steps of an active-set method follow
      (`take_active_set_steps`).
    - After `MAX_SWEEPS`, if bodies still overlap, surfaces have no friction in this step.

    A solve ends with a sweep that changes no force component by more than the tolerance; after the first sweep the
    residual must be small too (`has_small_residual`). Forces are inside their cones, converged or not.

    Args:
        problem: ContactProblem. In: ``motion`` without contact forces, and forces to start from. Out: the solution.
        W: (3 k, 3 k) float64. Delassus operator, in m/N.
        effort: (iterations, tolerance_n). Maximum number of sweeps, exceeded only while bodies overlap
            (`MOTION_TOLERANCE_M`), and tolerance of the forces in N.
    """
    iterations, tolerance_n = effort
    for row in range(W.shape[0]):
        problem.free[row] = problem.motion[row]
    update_motion(problem, W)
    sweeps, last_n, lowest_j = 0, 0.0, math.inf
    has_friction, most_sweeps = True, max(MAX_SWEEPS, iterations)
    k = problem.rows.n_contacts
    while True:
        change_n, change_m = sweep(problem, W)
        sweeps += 1
        is_small = change_n <= tolerance_n
        if is_small and (sweeps > 1 or has_small_residual(problem, tolerance_n)):
            return sweeps
        if sweeps >= iterations and change_m <= MOTION_TOLERANCE_M:
            return sweeps
        if sweeps >= most_sweeps:
            if not has_friction:
                return sweeps
            problem.rows.friction[:k] = 0.0
            has_friction, lowest_j = False, math.inf
            # Every contact may leave in a step of its own.
            most_sweeps = sweeps + MAX_SWEEPS + k * active_set_cost(k, k)
        # If the changes go on falling at this rate, the next sweep converges: it is cheaper than a Newton step.
        ends_next = change_n * change_n <= tolerance_n * last_n
        last_n = change_n
        is_cheaper = not is_small and sweeps == 1 and change_n <= NEAR * tolerance_n
        if ends_next or is_cheaper:
            continue
        newton_sweeps, is_solved, lowest_j = _try_newton_step(problem, W, tolerance_n, lowest_j)
        sweeps, last_n = sweeps + newton_sweeps, 0.0
        if is_solved:
            return sweeps


@kernel
def _potential(problem: ContactProblem) -> float:
    """Return 1/2 f^T W f + f^T u_free in J."""
    total, force, motion, free = 0.0, problem.rows.force_n, problem.motion, problem.free
    for block in range(problem.rows.n_contacts):
        for axis in range(3):
            total += 0.5 * force[block, axis] * (motion[3 * block + axis] + free[3 * block + axis])
    return total


@inlined_kernel
def _try_newton_step(
    problem: ContactProblem, W: FloatArray, tolerance_n: float, lowest_j: float
) -> tuple[int, bool, float]:
    """Try a Newton step and a sweep; if they do not lower the potential, take steps of the active-set method instead.

    They have to lower it below ``lowest_j`` too, the lowest of this solve, because sweeps may raise it again: Newton
    step and sweep would alternate for ever. Return the cost in sweeps, whether the sweep changed no force by more than
    the tolerance, and the lowest potential.
    """
    rows = problem.rows
    lowest_j = min(lowest_j, _potential(problem))
    copy_forces(rows.force_n, problem.saved_n, rows.n_contacts)
    n = list_unknowns(problem)
    if n == 0 or not newton_step(problem, W, n):
        return 0, False, lowest_j
    add_step(problem, n, 1.0)
    update_motion(problem, W)
    if sweep(problem, W)[0] <= tolerance_n:
        return 1, True, lowest_j
    reached_j = _potential(problem)
    if reached_j < lowest_j:
        return 1, False, reached_j
    copy_forces(problem.saved_n, rows.force_n, rows.n_contacts)
    update_motion(problem, W)
    return 1 + take_active_set_steps(problem, W, n), False, lowest_j
