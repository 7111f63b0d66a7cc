"""Projected block Gauss-Seidel (PGS) with Newton steps, on a dense Delassus operator."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Struct
from services.mechanics.contact import laws
from services.mechanics.contact.laws.law import ContactProblem, Unknowns
from services.mechanics.contact.newton import add_step, list_unknowns, newton_step, room_for_step

# Times the tolerance: a first sweep that changes less is followed by another, which costs less than a Newton step.
NEARLY_THERE = 100.0
# And later ones that change less than this, by as many sweeps as cost half of a Newton step: that is a dense solve, as
# dear as a sweep for every two contacts.
ALL_BUT_THERE = 4.0
CONTACTS_A_SWEEP = 4
# A solve that may take no more sweeps goes on while one has moved a surface by more than this along its normal, as far
# as that sweep knows: contacts that come first in a sweep know nothing of those after them, and bodies would overlap by
# so much and more. One of fifty ticks of a hard case needs more than thirty; broken off, they gain energy, too.
FAR_M = 1e-6
MOST_SWEEPS = 100
# One that has taken so many is slow: from then on Newton steps lead from one contact that opens or slips to the next.
SLOW_SWEEPS = 30
# Beyond where one opens or slips by so much of the step: it has to be seen to have done so.
BEYOND = 1e-9
# What comes of a Newton step.
NOT_KEPT, IN_PART, KEPT, SOLVED = 0, 1, 2, 3


class SolverScratch(Struct):
    """Work space of a solve with at most m rows."""

    unknowns: Unknowns
    force: Annotated[FloatArray, "c", 3]
    way: Annotated[FloatArray, "c", 3]  # what a Newton step would change of them
    free: Annotated[FloatArray, "m"]

    @classmethod
    def allocate(cls, capacity: int) -> SolverScratch:
        """Return work space for ``capacity`` contacts."""
        m = 3 * capacity
        unknowns = Unknowns.zeros(m=m, matrix=np.zeros(m * m))
        return cls.zeros(c=capacity, m=m, unknowns=unknowns)


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
    Where neither comes to an end soon, Newton steps go on until one is left whole (`_go_down`), between single sweeps.
    The cost is bounded by the number of sweeps, or by `MOST_SWEEPS` while bodies are in each other. Forces are inside
    their cones, converged or not.

    Parameters
    ----------
    problem : ContactProblem
        In: ``motion`` without contact forces, forces to start from. Out: the solution.
    W : (3 k, 3 k) float64
        Delassus operator.
    effort : (iterations, tolerance_n)
        Most sweeps where bodies are apart (`FAR_M`), and the change of any force component in a sweep at which to stop.
    scratch : SolverScratch
    """
    iterations, tolerance_n = effort
    for row in range(W.shape[0]):
        scratch.free[row] = problem.motion[row]
    _update_motion(problem, W, scratch.free)
    sweeps, patience, last_n = 0, 1, 0.0
    cheap = problem.rows.n_contacts // CONTACTS_A_SWEEP
    due = patience
    while True:
        change_n, change_m = _sweep(problem, W)
        sweeps += 1
        is_over = sweeps >= iterations and (change_m <= FAR_M or sweeps >= MOST_SWEEPS)
        if change_n <= tolerance_n or is_over:
            return sweeps
        # Falling as before, the next change would be within the tolerance: a sweep is cheaper than a Newton step.
        ends_next = change_n * change_n <= tolerance_n * last_n
        last_n = change_n
        near = NEARLY_THERE if sweeps == 1 else ALL_BUT_THERE
        is_cheaper = sweeps <= max(cheap, 1) and change_n <= near * tolerance_n
        if sweeps >= SLOW_SWEEPS:
            sweeps += _go_down(problem, W, scratch)
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


@kernel
def _sweep(problem: ContactProblem, W: FloatArray) -> tuple[float, float]:
    """Relax every contact once; return the largest change of a force component, and of a place along its normal."""
    largest_n, largest_m, rows, change = 0.0, 0.0, problem.rows, problem.change
    for block in range(rows.n_contacts):
        laws.relax(rows.law[block], problem, W, block)
        largest_n = max(largest_n, abs(change[0]), abs(change[1]), abs(change[2]))
        largest_m = max(largest_m, abs(change[0]) * W[3 * block, 3 * block])
    return largest_n, largest_m


@kernel
def _try_newton_step(
    problem: ContactProblem, W: FloatArray, tolerance_n: float, scratch: SolverScratch
) -> tuple[int, int]:
    """Take a Newton step that with a sweep after it lowers the potential: all of it, or what there is room for.

    Return how many sweeps that took, and what came of it; where it is `NOT_KEPT` the forces are as they were.
    """
    rows, unknowns, sweeps, share = problem.rows, scratch.unknowns, 0, 1.0
    before = _potential(problem, scratch.free)
    _copy_forces(rows.force_n, scratch.force, rows.n_contacts)
    n = list_unknowns(problem, unknowns)
    if n == 0 or not newton_step(problem, W, unknowns, n):
        return sweeps, NOT_KEPT
    for _ in range(2):
        add_step(problem, unknowns, n, share)
        _update_motion(problem, W, scratch.free)
        sweeps += 1
        if _sweep(problem, W)[0] <= tolerance_n:
            return sweeps, SOLVED
        if _potential(problem, scratch.free) < before:
            return sweeps, KEPT if share == 1.0 else IN_PART
        _copy_forces(scratch.force, rows.force_n, rows.n_contacts)
        _update_motion(problem, W, scratch.free)
        share = room_for_step(problem, unknowns, n, scratch.way)
        if share >= 1.0:
            break
    return sweeps, NOT_KEPT


@kernel
def _go_down(problem: ContactProblem, W: FloatArray, scratch: SolverScratch) -> int:
    """Take Newton steps, each up to where a contact opens or slips, until one goes all the way; return what they cost.

    So a method of active sets minimises over what is closed, and sweeps close what is missing (Nocedal and Wright,
    "Numerical Optimization", 16.5). One step between sweeps does not: they close again what it has opened. Friction
    makes it no minimum, and the potential need not fall. The cost is in sweeps: a dense solve of many is dear.
    """
    unknowns, cost, k, share = scratch.unknowns, 0, problem.rows.n_contacts, 0.0
    while share < 1.0 and cost < SLOW_SWEEPS:
        n = list_unknowns(problem, unknowns)
        if n == 0 or not newton_step(problem, W, unknowns, n):
            return cost
        cost += 1 + n**3 // (27 * k * k)
        share = room_for_step(problem, unknowns, n, scratch.way)
        add_step(problem, unknowns, n, min(share * (1.0 + BEYOND), 1.0))
        _update_motion(problem, W, scratch.free)
    return cost


@kernel
def _copy_forces(source: FloatArray, target: FloatArray, count: int) -> None:
    for block in range(count):
        for axis in range(3):
            target[block, axis] = source[block, axis]


@kernel
def _update_motion(problem: ContactProblem, W: FloatArray, free: FloatArray) -> None:
    """Write the motion u = W f + u_free."""
    motion = problem.motion
    for row in range(W.shape[0]):
        motion[row] = free[row]
    for block in range(problem.rows.n_contacts):
        for axis in range(3):
            force = problem.rows.force_n[block, axis]
            if force != 0.0:
                for column in range(W.shape[0]):
                    motion[column] += W[3 * block + axis, column] * force
