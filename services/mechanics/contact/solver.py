"""Projected block Gauss-Seidel (PGS) with Newton steps, on a dense Delassus operator."""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import copy_rows
from trocar.services.mechanics.contact.active_set import CYCLING, take_newton_steps
from trocar.services.mechanics.contact.newton import cost_in_sweeps
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.sweeps import has_small_residual, sweep, update_motion

# If the first sweep changes forces by less than this multiple of the tolerance, another one follows instead of a Newton
# step, which costs as much as several.
NEAR = 10.0
# A solve goes beyond its allowed sweeps while a sweep moves a surface by more than this along its normal. Bodies would
# overlap by at least as much, because a contact relaxed early in a sweep does not see the changes after it. In a hard
# case one tick of fifty needs more than thirty sweeps; if such solves were cut short, the bodies would gain energy.
MOTION_TOLERANCE_M = 1e-6
# After so many, or Newton steps that cost as much, a solve that cycles is ended: those that associated friction mended,
# of up to 30 contacts, took 40 more. Coulomb's law has no potential, because the bound on friction changes with the
# normal force; without friction the solution is the minimum of a convex one.
MAX_SWEEPS = CYCLING + 50


@kernel
def solve_contacts(problem: ContactProblem, W: FloatArray, effort: tuple[int, float]) -> int:
    r"""Solve the contact problem of one step in place and return the number of sweeps.

    The relative motion of the contact points is :math:`u = W f + u_{free}`. Each contact is a block of three rows
    (normal, two tangents), whose force and motion obey the contact's law.

    - A block Gauss-Seidel sweep solves each block exactly with the others fixed: first the normal, then the tangents
      within the friction cone. Sweeps find the active set (which contacts are pressed, and which stick), but converge
      slowly where a stiff catheter couples contacts.
    - So Newton steps between sweeps solve for all active force components together (`active_set`), as in PGS with
      subspace minimisation (Silcowitz-Hansen, Niebe and Erleben, 2010).
    - After `MAX_SWEEPS` the forces are taken whose sweep moved surfaces least, if that was less than the overlap that
      the problem tolerates. Otherwise surfaces have no friction in this step.

    A solve ends with a sweep that changes no force component by more than the tolerance; after the first sweep the
    residual must be small too (`has_small_residual`). Forces are inside their cones, converged or not.

    Args:
        problem: ContactProblem. In: ``free``, and forces to start from. Out: ``motion`` and forces.
        W: (3 k, 3 k) float64. Delassus operator, in m/N.
        effort: (iterations, tolerance_n). Maximum number of sweeps, exceeded only while bodies overlap
            (`MOTION_TOLERANCE_M`), and tolerance of the forces in N.
    """
    iterations, tolerance_n = effort
    update_motion(problem, W)
    sweeps, last_n, least_m, problem.lowest_j = 0, 0.0, math.inf, math.inf
    has_friction, most_sweeps = True, max(MAX_SWEEPS, iterations)
    k = problem.rows.n_contacts
    while True:
        change_n, change_m = sweep(problem, W)
        sweeps += 1
        is_small = change_n <= tolerance_n
        if is_small and (sweeps > 1 or has_small_residual(problem, tolerance_n)):
            return sweeps
        if sweeps >= iterations:
            if change_m <= MOTION_TOLERANCE_M:
                return sweeps
            if change_m < least_m:
                least_m = change_m
                copy_rows(problem.rows.force_n, problem.saved_n, k)
        if sweeps >= most_sweeps:
            if least_m <= problem.tolerated_m:
                copy_rows(problem.saved_n, problem.rows.force_n, k)
                update_motion(problem, W)
                return sweeps
            if not has_friction:
                return sweeps
            problem.rows.friction[:k] = 0.0
            has_friction, problem.lowest_j = False, math.inf
            # Every contact may leave in a step of its own.
            most_sweeps = sweeps + MAX_SWEEPS + k * cost_in_sweeps(k, k)
        # If the changes go on falling at this rate, the next sweep converges: it is cheaper than a Newton step.
        ends_next = change_n * change_n <= tolerance_n * last_n
        last_n = change_n
        is_cheaper = not is_small and sweeps == 1 and change_n <= NEAR * tolerance_n
        if ends_next or is_cheaper:
            continue
        cost, is_solved = take_newton_steps(problem, W, tolerance_n, sweeps)
        sweeps, last_n = sweeps + cost, 0.0
        if is_solved:
            return sweeps
