"""Projected block Gauss-Seidel (PGS) with Newton steps, on a dense Delassus operator."""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import copy_rows
from trocar.services.mechanics.contact.active_set import take_newton_steps
from trocar.services.mechanics.contact.admissible import keeps_friction, project
from trocar.services.mechanics.contact.islands import find_islands, note_settled
from trocar.services.mechanics.contact.laws import HAS_FRICTION
from trocar.services.mechanics.contact.problem import UNBOUNDED, ContactProblem
from trocar.services.mechanics.contact.rows import KEPT, PRESENT
from trocar.services.mechanics.contact.sweeps import (
    can_sweep,
    has_small_residual,
    products_of_sweep,
    set_aside,
    sweep,
    update_motion,
)

# If the first sweep changes forces by less than this multiple of the tolerance, another one follows instead of a Newton
# step, which costs as much as several.
NEAR = 10.0
# A solve goes beyond its allowed sweeps while a sweep moves a surface by more than this along its normal. Bodies would
# overlap by at least as much, because a contact relaxed early in a sweep does not see the changes after it. In a hard
# case one tick of fifty needs more than thirty sweeps; if such solves were cut short, the bodies would gain energy.
MOTION_TOLERANCE_M = 1e-6
# After the work of so many sweeps a solve is taken to cycle. Of recorded solves that end 99 % take less than half.
CYCLING = 250
# Then friction and normal forces are found in so many turns, with friction in so many sweeps.
TURNS, FRICTION_SWEEPS = 2, 10


@kernel
def solve_contacts(problem: ContactProblem, W: FloatArray, effort: tuple[int, float]) -> int:
    r"""Solve the contact problem of one step in place and return the number of sweeps.

    The relative motion of the contact points is :math:`u = W f + u_{free}`. Each contact is a block of three rows
    (normal, two tangents), whose force and motion obey the contact's law.

    - A block Gauss-Seidel sweep solves each block exactly with the others fixed: first the normal, then the tangents
      within the friction cone. Sweeps find the active set (which contacts are pressed, and which stick), but converge
      slowly where a stiff catheter couples contacts.
    - So Newton steps between sweeps solve for all active force components together (`active_set`), as in PGS with
      subspace minimisation (Silcowitz-Hansen, Niebe and Erleben, 2010), but for those of `islands` that sweeps have
      solved.
    - Coulomb's law has no potential, because the bound on friction changes with the normal force: a solve may cycle.
      After `CYCLING` it goes on in turns from the forces that it began with. The pressures of the last turn bound
      friction while some sweeps find it; it is then kept, within the cones of the pressures found by them, while the
      normal forces are found: the minimum of a strictly convex potential. So next to nothing overlaps, and friction is
      that of almost this motion. Where it would drive the slip, all contacts together, it is weakened.

    A solve ends with a sweep that changes no force component by more than the tolerance; after the first sweep the
    residual must be small too (`has_small_residual`). It takes no more work than ``products_left``, of which each stage
    leaves half to what comes after it. A solve that this cuts short ends with the multiple of its forces at which the
    potential is least: their work is then zero. Forces obey their laws, converged or not.

    Args:
        problem: ContactProblem. In: ``free``, forces to start from, and ``products_left``. Out: ``motion``, forces, and
            what is left then.
        W: (3 k, 3 k) float64. Delassus operator, in m/N.
        effort: (iterations, tolerance_n). Maximum number of sweeps, exceeded only while bodies overlap
            (`MOTION_TOLERANCE_M`), and tolerance of the forces in N.
    """
    rows, k = problem.rows, problem.rows.n_contacts
    rows.pressure_n[:k] = PRESENT
    copy_rows(rows.force_n, problem.first_n, k)
    update_motion(problem, W)
    allowed = max(CYCLING, effort[0]) * products_of_sweep(problem)
    kept = set_aside(problem, allowed)
    sweeps, is_solved = _iterate(problem, W, effort)
    cycles = kept > allowed
    problem.products_left += kept
    if not is_solved and can_sweep(problem):
        if cycles:
            copy_rows(problem.first_n, rows.force_n, k)
        more, is_solved = _take_turns(problem, W, effort)
        sweeps += more
    problem.is_cut = not is_solved
    if not is_solved:
        _take_least_multiple(problem, W)
    return sweeps


@kernel
def _take_turns(problem: ContactProblem, W: FloatArray, effort: tuple[int, float]) -> tuple[int, bool]:
    """Find friction and normal forces in turns; return the number of sweeps, and whether the last turn was solved."""
    sweeps, is_solved = 0, False
    for turn in range(TURNS):
        kept = set_aside(problem, UNBOUNDED) if turn < TURNS - 1 else 0.0
        _bound_friction(problem)
        update_motion(problem, W)
        for _ in range(FRICTION_SWEEPS):
            if can_sweep(problem):
                sweep(problem, W)
                sweeps += 1
        _keep_friction(problem)
        more, is_solved = _find_normal_forces(problem, W, effort)
        sweeps += more
        problem.products_left += kept
    return sweeps, is_solved


@kernel
def _find_normal_forces(problem: ContactProblem, W: FloatArray, effort: tuple[int, float]) -> tuple[int, bool]:
    """Find the normal forces with the friction that is kept, again with less of it as long as it drives.

    Return the number of sweeps, and whether they were found.
    """
    sweeps, is_solved = 0, True
    while is_solved:
        update_motion(problem, W)
        more, is_solved = _iterate(problem, W, effort)
        sweeps += more
        if not (is_solved and _weaken_friction(problem, W)):
            break
    return sweeps, is_solved


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
def _weaken_friction(problem: ContactProblem, W: FloatArray) -> bool:
    """Leave the share of the friction that is kept at which it does no work, if it drives the slip beyond rounding.

    That is at the present normal forces. Return whether any changes: contacts that have opened lose theirs.
    """
    rows, motion, work_j, slack_j, opened_n = problem.rows, problem.motion, 0.0, 0.0, 0.0
    for row in range(rows.n_contacts):
        if keeps_friction(rows, row):
            f_1, f_2 = rows.force_n[row, 1], rows.force_n[row, 2]
            work_j += f_1 * motion[3 * row + 1] + f_2 * motion[3 * row + 2]
            slack_j += MOTION_TOLERANCE_M * math.hypot(f_1, f_2)
            if rows.force_n[row, 0] <= 0.0:
                opened_n += math.hypot(f_1, f_2)
    drives = work_j > slack_j
    left = max(1.0 - work_j / _friction_potential_j(problem, W), 0.0) if drives else 1.0
    for row in range(rows.n_contacts):
        if keeps_friction(rows, row):
            kept = left if rows.force_n[row, 0] > 0.0 else 0.0
            rows.force_n[row, 1] *= kept
            rows.force_n[row, 2] *= kept
    return bool(drives or opened_n > 0.0)


@kernel
def _friction_potential_j(problem: ContactProblem, W: FloatArray) -> float:
    """Return f W f (J) of the friction that is kept alone."""
    rows, along, total = problem.rows, problem.along[: W.shape[0]], 0.0
    problem.products_left -= products_of_sweep(problem)
    along[:] = 0.0
    for block in range(rows.n_contacts):
        if keeps_friction(rows, block):
            for row in range(3 * block + 1, 3 * block + 3):
                force = rows.force_n[block, row - 3 * block]
                for column in range(along.shape[0]):
                    along[column] += W[row, column] * force
    for block in range(rows.n_contacts):
        if keeps_friction(rows, block):
            total += rows.force_n[block, 1] * along[3 * block + 1] + rows.force_n[block, 2] * along[3 * block + 2]
    return total


@kernel
def _take_least_multiple(problem: ContactProblem, W: FloatArray) -> None:
    """Multiply all forces by the share, at most one, at which their potential is least: there they do no work.

    Before that friction is projected into the cones of the present pressures. It counts as slipping: the next step must
    not bring back what has slipped while nothing was solved.
    """
    rows, motion, free, bent_j, work_j = problem.rows, problem.motion, problem.free, 0.0, 0.0
    rows.pressure_n[: rows.n_contacts] = PRESENT
    for row in range(rows.n_contacts):
        project(rows, row, False)
    update_motion(problem, W)
    for row in range(rows.n_contacts):
        for axis in range(3):
            force, at = rows.force_n[row, axis], 3 * row + axis
            bent_j += force * (motion[at] - free[at])
            work_j += force * motion[at]
    share = max(1.0 - work_j / bent_j, 0.0) if work_j > 0.0 else 1.0
    for row in range(rows.n_contacts):
        for axis in range(3):
            rows.force_n[row, axis] *= share
            motion[3 * row + axis] = free[3 * row + axis] + share * (motion[3 * row + axis] - free[3 * row + axis])
        if HAS_FRICTION[rows.law[row]] and rows.friction[row] > 0.0:
            rows.pressure_n[row] = math.hypot(rows.force_n[row, 1], rows.force_n[row, 2]) / rows.friction[row]


@kernel
def _iterate(problem: ContactProblem, W: FloatArray, effort: tuple[int, float]) -> tuple[int, bool]:
    """Sweep and take Newton steps; return their cost in sweeps, and whether they ended before the work was spent."""
    (iterations, tolerance_n), sweeps, last_n, problem.lowest_j = effort, 0, 0.0, math.inf
    knows_islands = False
    while True:
        change_n, change_m = sweep(problem, W)
        sweeps += 1
        is_small = change_n <= tolerance_n
        if is_small and (sweeps > 1 or has_small_residual(problem, tolerance_n)):
            return sweeps, True
        if sweeps >= iterations and change_m <= MOTION_TOLERANCE_M:
            return sweeps, True
        if not can_sweep(problem):
            return sweeps, False
        # If the changes go on falling at this rate, the next sweep converges: it is cheaper than a Newton step.
        ends_next = change_n * change_n <= tolerance_n * last_n
        last_n = change_n
        is_cheaper = not is_small and sweeps == 1 and change_n <= NEAR * tolerance_n
        if ends_next or is_cheaper:
            continue
        if not knows_islands:
            find_islands(problem, W)
            knows_islands = True
        note_settled(problem, tolerance_n)
        cost, is_solved = take_newton_steps(problem, W, tolerance_n, sweeps)
        sweeps, last_n = sweeps + cost, 0.0
        if is_solved:
            return sweeps, True
