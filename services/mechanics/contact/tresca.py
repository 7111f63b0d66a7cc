r"""Friction and pressure solved in turns, where a solve cycles: each turn ends, the last leaves no overlap.

Coulomb's law has no potential, because the bound of friction changes with the pressure. So neither a sweep nor a Newton
step need approach the solution, and a few contacts may open, slip and close again in the same order for ever. With
bounds :math:`|f_t| \le r` in the place of :math:`\mu f_n` (Tresca's friction) the solution is the minimum of a strictly
convex potential, and active sets find it. Its pressures give the next bounds, :math:`r = \mu f_n`; Coulomb's solution
is where these do not change (Panagiotopoulos, 1975; Haslinger, Hlavacek and Necas, "Numerical Methods for Unilateral
Problems in Solid Mechanics", 1996). A turn finds which contacts are open, stick and slide, so a Newton step on
Coulomb's law from there mostly ends the solve.

If the turns do not converge either, bounds are halved, and a contact whose friction still exceeds :math:`\mu f_n` bears
none. Then the turns end: all pressures obey the law, nothing overlaps, and friction opposes the slip and is nowhere
above its cone, but below it at some sliding contact, for this one step. In a solve that has used up `MOST_BLOCKS` no
sliding contact bears friction in the last turn.
"""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.contact.admissible import ON_THE_LIMIT
from services.mechanics.contact.laws import HAS_GAP
from services.mechanics.contact.newton import add_step, list_unknowns, newton_step
from services.mechanics.contact.problem import ContactProblem
from services.mechanics.contact.rows import ContactRows
from services.mechanics.contact.solver_steps import SolverScratch, copy_forces, go_down, sweep, update_motion

# Most turns for Coulomb's law; none begins once they have cost half of `MOST_BLOCKS`.
MOST_TURNS = 6
# Share of the coefficients' bounds after that. With all of it half as much friction is left: more contacts exceed their
# cones, lose their friction, and the load goes to others.
LEFT = 0.5
# Most sweeps of a turn, each after Newton steps; the rest is left to the next turn.
MOST_SWEEPS_A_TURN = 20
# Blocks of W, 1.5 ms, after which the next turn is the last. A sweep of k contacts visits k^2 of them.
MOST_BLOCKS = 600_000


@inlined_kernel
def solve_in_turns(
    problem: ContactProblem, W: FloatArray, tolerance_n: float, scratch: SolverScratch, spent: int
) -> int:
    """Solve the contact problem from its present forces, in place; return the cost in sweeps, ``spent`` included.

    Coefficients of friction that had to be lowered stay so: with them the forces obey Coulomb's law.
    """
    rows, cost, turn = problem.rows, spent, 0
    at_most = MOST_BLOCKS // rows.n_contacts**2
    for row in range(rows.n_contacts):
        scratch.friction[row] = rows.friction[row]
    while turn < MOST_TURNS and cost < at_most // 2:
        _give_bounds(rows, scratch.friction, 1.0)
        cost += _press(problem, W, tolerance_n, scratch)
        more, is_solved = _rub(problem, W, tolerance_n, scratch)
        cost += more
        if is_solved:
            return cost
        turn += 1
    _give_bounds(rows, scratch.friction, LEFT if cost < at_most else 0.0)
    cost += _press(problem, W, tolerance_n, scratch)
    while _take_bounds(rows, scratch.friction):
        if cost >= at_most:
            rows.rubbing_n[: rows.n_contacts] = 0.0
        cost += _press(problem, W, tolerance_n, scratch)
    _lower_coefficients(rows, scratch.friction)
    return cost


@kernel
def _give_bounds(rows: ContactRows, friction: FloatArray, share: float) -> None:
    """Bound friction by this share of what the coefficients allow with the present pressures."""
    for row in range(rows.n_contacts):
        if HAS_GAP[rows.law[row]]:
            rows.rubbing_n[row] = share * friction[row] * rows.force_n[row, 0]
            rows.friction[row] = 0.0


@kernel
def _press(problem: ContactProblem, W: FloatArray, tolerance_n: float, scratch: SolverScratch) -> int:
    """Minimise the potential within the bounds; return the cost in sweeps."""
    cost, sweeps = 0, 0
    while sweeps < MOST_SWEEPS_A_TURN:
        cost += go_down(problem, W, scratch) + 1
        sweeps += 1
        if sweep(problem, W)[0] <= tolerance_n:
            break
    return cost


@inlined_kernel
def _rub(problem: ContactProblem, W: FloatArray, tolerance_n: float, scratch: SolverScratch) -> tuple[int, bool]:
    """Try a Newton step on Coulomb's law; return its cost, and whether it solved the law. If not, restore the forces.

    The friction of a contact on its bound is first set to what its coefficient allows.
    """
    rows, k, unknowns = problem.rows, problem.rows.n_contacts, scratch.unknowns
    copy_forces(rows.force_n, scratch.force, k)
    for row in range(k):
        force, limit = rows.force_n[row], scratch.friction[row] * rows.force_n[row, 0]
        rubs_n = math.hypot(force[1], force[2])
        if HAS_GAP[rows.law[row]] and rubs_n > 0.0 and rubs_n >= ON_THE_LIMIT * rows.rubbing_n[row]:
            _scale(force, limit / rubs_n)
        rows.friction[row], rows.rubbing_n[row] = scratch.friction[row], 0.0
    update_motion(problem, W, scratch.free)
    n = list_unknowns(problem, unknowns)
    if newton_step(problem, W, unknowns, n):
        add_step(problem, unknowns, n, 1.0)
        update_motion(problem, W, scratch.free)
    cost = 2 + n**3 // (27 * k * k)
    if sweep(problem, W)[0] <= tolerance_n:
        return cost, True
    copy_forces(scratch.force, rows.force_n, k)
    update_motion(problem, W, scratch.free)
    return cost, False


@kernel
def _take_bounds(rows: ContactRows, friction: FloatArray) -> bool:
    """Remove the friction of contacts that exceed their cone; return whether there are any."""
    is_above = False
    for row in range(rows.n_contacts):
        force, limit = rows.force_n[row], friction[row] * rows.force_n[row, 0]
        if HAS_GAP[rows.law[row]] and rows.rubbing_n[row] > 0.0 and math.hypot(force[1], force[2]) > limit:
            rows.rubbing_n[row] = 0.0
            is_above = True
    return is_above


@kernel
def _scale(force: FloatArray, factor: float) -> None:
    """Multiply the friction of a contact."""
    force[1] *= factor
    force[2] *= factor


@kernel
def _lower_coefficients(rows: ContactRows, friction: FloatArray) -> None:
    """Remove the bounds; a contact that slides on a lowered bound gets the coefficient with which it slides."""
    for row in range(rows.n_contacts):
        if HAS_GAP[rows.law[row]]:
            force, limit = rows.force_n[row], friction[row] * rows.force_n[row, 0]
            rubs_n = math.hypot(force[1], force[2])
            is_lowered = rubs_n < limit and rubs_n >= ON_THE_LIMIT * rows.rubbing_n[row]
            rows.friction[row] = rubs_n / force[0] if is_lowered else friction[row]
            rows.rubbing_n[row] = 0.0
