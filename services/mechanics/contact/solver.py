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
from trocar.services.mechanics.contact.problem import ContactProblem
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
# That is at most so many block products, a twentieth of what a tick may take: up to 34 contacts they are more. Where
# a wall lies on a wide catheter in 30 to 175 contacts, half of 43 recorded solves took 2.5 million and more, and a
# quarter 20; with this bound they take 0.8 million, and 4.4 at most.
MOST_BY_COULOMB = 300_000.0
# Then friction and normal forces are found in so many turns at most, with friction in so many sweeps.
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
      After `CYCLING`, or `MOST_BY_COULOMB`, it goes on in turns from the forces that it began with. The pressures of
      the last turn bound friction while some sweeps find it; it is then kept, within the cones of the pressures found
      by them, while the normal forces are found: the minimum of a strictly convex potential. So next to nothing
      overlaps, and friction is that of almost this motion. Where it would drive the slip, all contacts together, those
      that do so lose it. A share of all of it would be found in hundreds of rounds, because normal forces follow.

    A solve ends with a sweep that changes no force component by more than the tolerance; after the first sweep the
    residual must be small too (`has_small_residual`). It takes no more work than ``products_left``, of which the first
    stage leaves a part to the turns. A second turn is begun only if twice the work of the first one is left. A solve
    that this cuts short ends with the multiple of its forces at which the potential is least: their work is then zero.
    Forces obey their laws, converged or not.

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
    sweeps, is_solved = 0, False
    if not problem.cycles:
        sweeps, is_solved = _iterate_by_coulomb(problem, W, effort)
    if not is_solved and can_sweep(problem):
        more, is_solved = _take_turns(problem, W, effort)
        sweeps += more
    problem.is_cut = not is_solved
    if not is_solved:
        _take_least_multiple(problem, W)
    return sweeps


@kernel
def _iterate_by_coulomb(problem: ContactProblem, W: FloatArray, effort: tuple[int, float]) -> tuple[int, bool]:
    """Iterate with friction bounded by the present pressures; return the number of sweeps, and whether it was solved.

    Where it cycles, the forces are those that the solve began with. Other solves of the same part of a step would
    cycle too, as they differ by some rows, or by how much overlap is recovered.
    """
    rows, k = problem.rows, problem.rows.n_contacts
    allowed = min(max(CYCLING, effort[0]) * products_of_sweep(problem), MOST_BY_COULOMB)
    kept = set_aside(problem, allowed)
    sweeps, is_solved = _iterate(problem, W, effort)
    problem.products_left += kept
    problem.cycles = not is_solved and kept > allowed
    if problem.cycles:
        copy_rows(problem.first_n, rows.force_n, k)
    return sweeps, is_solved


@kernel
def _take_turns(problem: ContactProblem, W: FloatArray, effort: tuple[int, float]) -> tuple[int, bool]:
    """Find friction and normal forces in turns; return the number of sweeps, and whether the last turn was solved.

    One that is solved is worth more than two that are not: none leaves work to the next.
    """
    sweeps, is_solved, cost = 0, False, 0.0
    for turn in range(TURNS):
        left = problem.products_left
        if turn > 0 and not (is_solved and left >= 2.0 * cost):
            break
        _bound_friction(problem)
        update_motion(problem, W)
        for _ in range(FRICTION_SWEEPS):
            if can_sweep(problem):
                sweep(problem, W)
                sweeps += 1
        _keep_friction(problem)
        more, is_solved = _find_normal_forces(problem, W, effort)
        sweeps += more
        cost = left - problem.products_left
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
        if not (is_solved and _weaken_friction(problem)):
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
def _weaken_friction(problem: ContactProblem) -> bool:
    """Drop the friction of contacts whose slip it drives, if that of all contacts together drives beyond rounding.

    That is at the present normal forces. Return whether any changes: contacts that have opened lose theirs too.
    """
    rows, work_j, slack_j, dropped_n = problem.rows, 0.0, 0.0, 0.0
    for row in range(rows.n_contacts):
        if keeps_friction(rows, row):
            work_j += _work_of_friction(problem, row)
            slack_j += MOTION_TOLERANCE_M * math.hypot(rows.force_n[row, 1], rows.force_n[row, 2])
    for row in range(rows.n_contacts):
        if keeps_friction(rows, row):
            size_n = math.hypot(rows.force_n[row, 1], rows.force_n[row, 2])
            drives = work_j > slack_j and _work_of_friction(problem, row) > MOTION_TOLERANCE_M * size_n
            if drives or rows.force_n[row, 0] <= 0.0:
                dropped_n += size_n
                rows.force_n[row, 1] = rows.force_n[row, 2] = 0.0
    return bool(dropped_n > 0.0)


@kernel
def _work_of_friction(problem: ContactProblem, row: int) -> float:
    """Return the work (J) of a contact's friction on the bodies."""
    force, motion = problem.rows.force_n, problem.motion
    return float(force[row, 1] * motion[3 * row + 1] + force[row, 2] * motion[3 * row + 2])


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
