"""Projected block Gauss-Seidel (PGS) with Newton steps, on a dense Delassus operator."""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import copy_rows
from trocar.services.mechanics.contact.active_set import take_newton_steps
from trocar.services.mechanics.contact.admissible import keeps_friction, project
from trocar.services.mechanics.contact.laws import HAS_FRICTION
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.rows import KEPT, PRESENT
from trocar.services.mechanics.contact.sweeps import has_small_residual, sweep, update_motion

# If the first sweep changes forces by less than this multiple of the tolerance, another one follows instead of a Newton
# step, which costs as much as several.
NEAR = 10.0
# A solve goes beyond its allowed sweeps while a sweep moves a surface by more than this along its normal. Bodies would
# overlap by at least as much, because a contact relaxed early in a sweep does not see the changes after it. In a hard
# case one tick of fifty needs more than thirty sweeps; if such solves were cut short, the bodies would gain energy.
MOTION_TOLERANCE_M = 1e-6
# After so many sweeps, or Newton steps that cost as much, a solve is taken to cycle. Of recorded solves that end 99 %
# take less than 70.
CYCLING = 125
# Then friction and normal forces are found in so many turns: friction in so many sweeps, normal forces at a cost of so
# many, and in the last turn again so often at most, with weaker friction.
TURNS, FRICTION_SWEEPS, MOST_SWEEPS, NORMAL_SOLVES = 2, 10, 100, 3


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
    - Coulomb's law has no potential, because the bound on friction changes with the normal force: a solve may cycle.
      After `CYCLING` it goes on in turns from the forces that it began with. The pressures of the last turn bound
      friction while some sweeps find it; it is then kept, within the cones of the pressures found by them, while the
      normal forces are found: the minimum of a strictly convex potential. So next to nothing overlaps, and friction is
      that of almost this motion. Where it would drive the slip, all contacts together, it is weakened.

    A solve ends with a sweep that changes no force component by more than the tolerance; after the first sweep the
    residual must be small too (`has_small_residual`). Forces obey their laws, converged or not.

    Args:
        problem: ContactProblem. In: ``free``, and forces to start from. Out: ``motion`` and forces.
        W: (3 k, 3 k) float64. Delassus operator, in m/N.
        effort: (iterations, tolerance_n). Maximum number of sweeps, exceeded only while bodies overlap
            (`MOTION_TOLERANCE_M`), and tolerance of the forces in N.
    """
    rows, k = problem.rows, problem.rows.n_contacts
    rows.pressure_n[:k] = PRESENT
    copy_rows(rows.force_n, problem.first_n, k)
    update_motion(problem, W)
    sweeps, is_solved = _iterate(problem, W, effort, max(CYCLING, effort[0]))
    if is_solved:
        return sweeps
    copy_rows(problem.first_n, rows.force_n, k)
    for turn in range(TURNS):
        _bound_friction(problem)
        update_motion(problem, W)
        for _ in range(FRICTION_SWEEPS):
            sweep(problem, W)
        _keep_friction(problem)
        sweeps += _find_normal_forces(problem, W, effort, NORMAL_SOLVES if turn == TURNS - 1 else 1)
    return sweeps + TURNS * FRICTION_SWEEPS


@kernel
def _find_normal_forces(problem: ContactProblem, W: FloatArray, effort: tuple[int, float], most: int) -> int:
    """Find the normal forces with the friction that is kept, again with less of it where it drives; return the cost.

    That is done ``most`` times at most, in the last of several without friction.
    """
    cost = 0
    for left in range(most - 1, -1, -1):
        update_motion(problem, W)
        cost += _iterate(problem, W, effort, MOST_SWEEPS)[0]
        if left == 0 or not _weaken_friction(problem, 0.5 if left > 1 else 0.0):
            break
    return cost


@kernel
def _bound_friction(problem: ContactProblem) -> None:
    """Let the present pressures bound friction."""
    rows = problem.rows
    for row in range(rows.n_contacts):
        if HAS_FRICTION[rows.law[row]]:
            project(rows, row, False)
            rows.pressure_n[row] = max(rows.force_n[row, 0], 0.0)


@kernel
def _keep_friction(problem: ContactProblem) -> None:
    """Keep friction as it is, within the cones of the present pressures."""
    rows = problem.rows
    for row in range(rows.n_contacts):
        if HAS_FRICTION[rows.law[row]]:
            rows.pressure_n[row] = PRESENT
            project(rows, row, False)
            rows.pressure_n[row] = KEPT - max(rows.force_n[row, 0], 0.0)


@kernel
def _weaken_friction(problem: ContactProblem, share: float) -> bool:
    """Leave a share of the friction that is kept, if all together it drives the slip by more than rounding.

    Return whether any changes: contacts that have opened lose theirs.
    """
    rows, motion, work_j, slack_j, opened_n = problem.rows, problem.motion, 0.0, 0.0, 0.0
    for row in range(rows.n_contacts):
        if keeps_friction(rows, row):
            f_1, f_2 = rows.force_n[row, 1], rows.force_n[row, 2]
            work_j += f_1 * motion[3 * row + 1] + f_2 * motion[3 * row + 2]
            slack_j += MOTION_TOLERANCE_M * math.hypot(f_1, f_2)
            if rows.force_n[row, 0] <= 0.0:
                opened_n += math.hypot(f_1, f_2)
    left = share if work_j > slack_j else 1.0
    for row in range(rows.n_contacts):
        if keeps_friction(rows, row):
            kept = left if rows.force_n[row, 0] > 0.0 else 0.0
            rows.force_n[row, 1] *= kept
            rows.force_n[row, 2] *= kept
    return bool(left < 1.0 or opened_n > 0.0)


@kernel
def _iterate(problem: ContactProblem, W: FloatArray, effort: tuple[int, float], most: int) -> tuple[int, bool]:
    """Sweep and take Newton steps; return their cost in sweeps, and whether they ended within ``most``."""
    (iterations, tolerance_n), sweeps, last_n, problem.lowest_j = effort, 0, 0.0, math.inf
    while True:
        change_n, change_m = sweep(problem, W)
        sweeps += 1
        is_small = change_n <= tolerance_n
        if is_small and (sweeps > 1 or has_small_residual(problem, tolerance_n)):
            return sweeps, True
        if sweeps >= iterations and change_m <= MOTION_TOLERANCE_M:
            return sweeps, True
        if sweeps >= most:
            return sweeps, False
        # If the changes go on falling at this rate, the next sweep converges: it is cheaper than a Newton step.
        ends_next = change_n * change_n <= tolerance_n * last_n
        last_n = change_n
        is_cheaper = not is_small and sweeps == 1 and change_n <= NEAR * tolerance_n
        if ends_next or is_cheaper:
            continue
        cost, is_solved = take_newton_steps(problem, W, tolerance_n, sweeps)
        sweeps, last_n = sweeps + cost, 0.0
        if is_solved:
            return sweeps, True
