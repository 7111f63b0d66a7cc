r"""Fixed-point iteration on Tresca friction, for contact problems on which the solver cycles.

Coulomb's law has no potential, because the bound on friction changes with the normal force. So neither sweeps nor
Newton steps need approach the solution, and contacts may open, slip and close in a cycle. With fixed bounds
:math:`|f_t| \le r` instead of :math:`\mu f_n` (Tresca friction) the solution is the minimum of a strictly convex
potential, which an active-set method finds. Its normal forces give the bounds of the next iteration,
:math:`r = \mu f_n`, and the fixed point is the solution of Coulomb's law (Panagiotopoulos, 1975; Haslinger, Hlavacek
and Necas, "Numerical Methods for Unilateral Problems in Solid Mechanics", 1996). Each iteration finds which contacts
are open, stick and slide, so a Newton step on Coulomb's law from there mostly ends the solve.

If the iteration does not converge either, the bounds are halved, and a contact whose friction still exceeds
:math:`\mu f_n` gets none. The result is safe: all normal forces obey the law, nothing overlaps, friction opposes the
slip and is inside its cone; for this one step it may be too small at some sliding contacts. If the solve has used up
`MAX_BLOCKS`, no sliding contact has friction in the last iteration.
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
from services.mechanics.contact.solver_steps import (
    SolverScratch,
    copy_forces,
    sweep,
    take_active_set_steps,
    update_motion,
)

# Maximum number of iterations; none begins once they have cost half of `MAX_BLOCKS`.
MAX_ITERATIONS = 6
# Factor on the bounds after that. With unreduced bounds only half as much friction would be left in the end: more
# contacts exceed their cones and lose their friction, and their load goes to others.
REDUCED_BOUNDS = 0.5
# Maximum number of sweeps of an iteration, each after active-set steps; the next iteration continues from there.
MAX_SWEEPS_PER_ITERATION = 20
# Visited blocks of W, about 1.5 ms, after which the next iteration is the last. A sweep of k contacts visits k^2.
MAX_BLOCKS = 600_000


@inlined_kernel
def solve_by_fixed_point(
    problem: ContactProblem, W: FloatArray, tolerance_n: float, scratch: SolverScratch, spent: int
) -> int:
    """Solve the contact problem from its present forces, in place; return the cost in sweeps, ``spent`` included.

    Coefficients of friction that had to be lowered stay lowered for this step: with them the forces obey Coulomb's law.
    """
    rows, cost, iteration = problem.rows, spent, 0
    max_cost = MAX_BLOCKS // rows.n_contacts**2
    for row in range(rows.n_contacts):
        scratch.friction[row] = rows.friction[row]
    while iteration < MAX_ITERATIONS and cost < max_cost // 2:
        _set_bounds(rows, scratch.friction, 1.0)
        cost += _minimise_within_bounds(problem, W, tolerance_n, scratch)
        more_cost, is_solved = _try_coulomb_step(problem, W, tolerance_n, scratch)
        cost += more_cost
        if is_solved:
            return cost
        iteration += 1
    _set_bounds(rows, scratch.friction, REDUCED_BOUNDS if cost < max_cost else 0.0)
    cost += _minimise_within_bounds(problem, W, tolerance_n, scratch)
    while _remove_excess_friction(rows, scratch.friction):
        if cost >= max_cost:
            rows.tresca_bound_n[: rows.n_contacts] = 0.0
        cost += _minimise_within_bounds(problem, W, tolerance_n, scratch)
    _lower_coefficients(rows, scratch.friction)
    return cost


@kernel
def _set_bounds(rows: ContactRows, friction: FloatArray, share: float) -> None:
    """Bound friction by ``share`` times mu f_n with the present normal forces, and set the coefficients to zero."""
    for row in range(rows.n_contacts):
        if HAS_GAP[rows.law[row]]:
            rows.tresca_bound_n[row] = share * friction[row] * rows.force_n[row, 0]
            rows.friction[row] = 0.0


@kernel
def _minimise_within_bounds(problem: ContactProblem, W: FloatArray, tolerance_n: float, scratch: SolverScratch) -> int:
    """Minimise the potential with the present bounds on friction; return the cost in sweeps."""
    cost, sweeps = 0, 0
    while sweeps < MAX_SWEEPS_PER_ITERATION:
        cost += take_active_set_steps(problem, W, scratch) + 1
        sweeps += 1
        if sweep(problem, W)[0] <= tolerance_n:
            break
    return cost


@inlined_kernel
def _try_coulomb_step(
    problem: ContactProblem, W: FloatArray, tolerance_n: float, scratch: SolverScratch
) -> tuple[int, bool]:
    """Try a Newton step on Coulomb's law; return its cost in sweeps, and whether it solved the problem.

    Friction on its bound is first scaled to mu f_n. If the step does not solve the problem, forces are restored.
    """
    rows, k, unknowns = problem.rows, problem.rows.n_contacts, scratch.unknowns
    copy_forces(rows.force_n, scratch.force, k)
    for row in range(k):
        force, limit = rows.force_n[row], scratch.friction[row] * rows.force_n[row, 0]
        tangential_n = math.hypot(force[1], force[2])
        if HAS_GAP[rows.law[row]] and tangential_n > 0.0 and tangential_n >= ON_THE_LIMIT * rows.tresca_bound_n[row]:
            _scale_friction(force, limit / tangential_n)
        rows.friction[row], rows.tresca_bound_n[row] = scratch.friction[row], 0.0
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


@inlined_kernel
def _remove_excess_friction(rows: ContactRows, friction: FloatArray) -> bool:
    """Set the bound of contacts whose friction is outside its cone to zero; return whether there are any."""
    is_above = False
    for row in range(rows.n_contacts):
        force, limit = rows.force_n[row], friction[row] * rows.force_n[row, 0]
        if HAS_GAP[rows.law[row]] and rows.tresca_bound_n[row] > 0.0 and math.hypot(force[1], force[2]) > limit:
            rows.tresca_bound_n[row] = 0.0
            is_above = True
    return is_above


@inlined_kernel
def _scale_friction(force: FloatArray, factor: float) -> None:
    """Multiply the tangential force (two of three components) by a factor."""
    force[1] *= factor
    force[2] *= factor


@inlined_kernel
def _lower_coefficients(rows: ContactRows, friction: FloatArray) -> None:
    """Remove the bounds; a contact that slides on a reduced bound gets the coefficient of friction that fits it."""
    for row in range(rows.n_contacts):
        if HAS_GAP[rows.law[row]]:
            force, limit = rows.force_n[row], friction[row] * rows.force_n[row, 0]
            tangential_n = math.hypot(force[1], force[2])
            is_lowered = tangential_n < limit and tangential_n >= ON_THE_LIMIT * rows.tresca_bound_n[row]
            rows.friction[row] = tangential_n / force[0] if is_lowered else friction[row]
            rows.tresca_bound_n[row] = 0.0
