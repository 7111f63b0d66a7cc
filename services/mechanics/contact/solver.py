"""Projected block Gauss-Seidel (PGS) with Newton steps, on a dense Delassus operator."""

from __future__ import annotations

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.contact.newton import add_step, list_unknowns, newton_step, room_for_step
from services.mechanics.contact.problem import ContactProblem
from services.mechanics.contact.solver_steps import (
    SolverScratch,
    copy_forces,
    go_down,
    is_balanced,
    sweep,
    update_motion,
)
from services.mechanics.contact.tresca import solve_in_turns

# Times the tolerance: a first sweep that changes less is followed by another, which costs less than a Newton step.
NEARLY_THERE = 100.0
# And later ones that change less than this, by as many sweeps as cost half of a Newton step: that is a dense solve, as
# dear as a sweep for every two contacts.
ALL_BUT_THERE = 4.0
CONTACTS_A_SWEEP = 4
# A solve that may take no more sweeps goes on while one has moved a surface by more than this along its normal, as far
# as that sweep knows: contacts that come first in a sweep know nothing of those after them, and bodies would overlap by
# so much and more. One of fifty ticks of a hard case needs more than thirty; broken off, they gain energy, too.
MOTION_TOLERANCE_M = 1e-6
# One that has taken so many is slow: from then on Newton steps lead from one contact that opens or slips to the next.
SLOW_SWEEPS = 30
# One that has not ended after so many runs in circles: friction and pressure are found in turns then.
MOST_SWEEPS = 60
# What comes of a Newton step.
NOT_KEPT, IN_PART, KEPT, SOLVED = 0, 1, 2, 3


@kernel
def solve_contacts(problem: ContactProblem, W: FloatArray, effort: tuple[int, float], scratch: SolverScratch) -> int:
    r"""Solve the contact problem of one step in place and return the number of sweeps.

    With the motion :math:`u = W f + u_{free}` each block of three rows (normal, tangent, tangent) obeys the law of its
    contact.

    Numerically: a sweep of block Gauss-Seidel solves each block exactly with the others fixed, normal first, then
    tangent in its cone. That finds who is pressed and who sticks, but converges slowly where a stiff catheter ties
    contacts together; so a Newton step solves for all that is closed together, as PGS with subspace minimisation does
    (Silcowitz-Hansen, Niebe and Erleben, 2010). It is kept if it and the next sweep lower the potential
    :math:`\tfrac12 f^T W f + f^T u_{free}`; how much a sweep changes would tell nothing, for sweeps that creep change
    little. If they do not, it goes only as far as nobody opens or slips. After a step that was not kept whole twice as
    many sweeps as before pass until the next: one that changes a contact at a time costs more than it brings.
    Where neither comes to an end soon, Newton steps go on until one is left whole (`go_down`), between single sweeps.
    A first sweep that changes little ends a solve only where forces are right, too (`is_balanced`).
    What has not ended after `MOST_SWEEPS` while bodies are in each other is solved in turns (`tresca`). Forces are
    inside their cones, converged or not.

    Args:
        problem: ContactProblem. In: ``motion`` without contact forces, forces to start from. Out: the solution.
        W: (3 k, 3 k) float64. Delassus operator.
        effort: (iterations, tolerance_n). Most sweeps where bodies are apart (`MOTION_TOLERANCE_M`), and the change of
            any force component in a sweep at which to stop.
    """
    iterations, tolerance_n = effort
    for row in range(W.shape[0]):
        scratch.free[row] = problem.motion[row]
    update_motion(problem, W, scratch.free)
    sweeps, patience, last_n = 0, 1, 0.0
    cheap = problem.rows.n_contacts // CONTACTS_A_SWEEP
    due = patience
    while True:
        change_n, change_m = sweep(problem, W)
        sweeps += 1
        is_small = change_n <= tolerance_n
        if is_small and (sweeps > 1 or is_balanced(problem, tolerance_n)):
            return sweeps
        if sweeps >= iterations and change_m <= MOTION_TOLERANCE_M:
            return sweeps
        if sweeps >= max(MOST_SWEEPS, iterations):
            return int(solve_in_turns(problem, W, tolerance_n, scratch, sweeps))
        # Falling as before, the next change would be within the tolerance: a sweep is cheaper than a Newton step.
        ends_next = change_n * change_n <= tolerance_n * last_n
        last_n = change_n
        near = NEARLY_THERE if sweeps == 1 else ALL_BUT_THERE
        is_cheaper = not is_small and sweeps <= max(cheap, 1) and change_n <= near * tolerance_n
        if sweeps >= SLOW_SWEEPS:
            sweeps += go_down(problem, W, scratch)
            continue
        if sweeps < due or ends_next or is_cheaper:
            continue
        more, outcome = _try_newton_step(problem, W, tolerance_n, scratch)
        sweeps += more
        if outcome == SOLVED:
            return sweeps
        patience = 1 if outcome == KEPT else 2 * patience
        due, last_n = sweeps + patience, 0.0


@kernel
def _potential(problem: ContactProblem, free: FloatArray) -> float:
    total, force, motion = 0.0, problem.rows.force_n, problem.motion
    for block in range(problem.rows.n_contacts):
        for axis in range(3):
            total += 0.5 * force[block, axis] * (motion[3 * block + axis] + free[3 * block + axis])
    return total


@inlined_kernel
def _try_newton_step(
    problem: ContactProblem, W: FloatArray, tolerance_n: float, scratch: SolverScratch
) -> tuple[int, int]:
    """Take a Newton step that with a sweep after it lowers the potential: all of it, or what there is room for.

    Return how many sweeps that took, and what came of it; where it is `NOT_KEPT` the forces are as they were.
    """
    rows, unknowns, sweeps, share = problem.rows, scratch.unknowns, 0, 1.0
    before = _potential(problem, scratch.free)
    copy_forces(rows.force_n, scratch.force, rows.n_contacts)
    n = list_unknowns(problem, unknowns)
    if n == 0 or not newton_step(problem, W, unknowns, n):
        return sweeps, NOT_KEPT
    for _ in range(2):
        add_step(problem, unknowns, n, share)
        update_motion(problem, W, scratch.free)
        sweeps += 1
        if sweep(problem, W)[0] <= tolerance_n:
            return sweeps, SOLVED
        if _potential(problem, scratch.free) < before:
            return sweeps, KEPT if share == 1.0 else IN_PART
        copy_forces(scratch.force, rows.force_n, rows.n_contacts)
        update_motion(problem, W, scratch.free)
        share = room_for_step(problem, unknowns, n, scratch.way)
        if share >= 1.0:
            break
    return sweeps, NOT_KEPT
