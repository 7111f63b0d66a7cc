r"""Tresca friction in place of Coulomb's, for contact problems on which the solver cycles.

Coulomb's law has no potential, because the bound on friction changes with the normal force. So neither sweeps nor
Newton steps need approach the solution, and contacts may open, slip and close in a cycle. With fixed bounds
:math:`|f_t| \le r` instead of :math:`\mu f_n` (Tresca friction) the solution is the minimum of a strictly convex
potential, which an active-set method finds.

The bounds are half of :math:`\mu f_n` with the normal forces of the last sweep, and a contact whose friction then
exceeds :math:`\mu f_n` gets none. The result is safe: all normal forces obey the law, nothing overlaps, friction
opposes the slip and is inside its cone; for this one step it is too small at some sliding contacts. If the solve has
used up `MAX_BLOCKS`, no sliding contact has friction.
"""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.contact.admissible import ON_THE_LIMIT
from services.mechanics.contact.laws import HAS_GAP
from services.mechanics.contact.newton import sweep, take_active_set_steps
from services.mechanics.contact.problem import ContactProblem
from services.mechanics.contact.rows import ContactRows

# Factor on the bounds. With unreduced bounds only half as much friction would be left in the end: more contacts exceed
# their cones and lose their friction, and their load goes to others.
REDUCED_BOUNDS = 0.5
# Maximum number of sweeps of a minimisation, each after active-set steps.
MAX_SWEEPS_PER_ITERATION = 20
# Visited blocks of W, about 1.5 ms, after which the next minimisation is the last. A sweep of k contacts visits k^2.
MAX_BLOCKS = 600_000


@inlined_kernel
def solve_with_less_friction(problem: ContactProblem, W: FloatArray, tolerance_n: float, spent: int) -> int:
    """Solve the contact problem from its present forces, in place; return the cost in sweeps, ``spent`` included.

    Coefficients of friction that had to be lowered stay lowered for this step: with them the forces obey Coulomb's law.
    """
    rows, cost, max_cost = problem.rows, spent, MAX_BLOCKS // problem.rows.n_contacts**2
    for row in range(rows.n_contacts):
        problem.friction[row] = rows.friction[row]
    _set_bounds(rows, problem.friction, REDUCED_BOUNDS if cost < max_cost else 0.0)
    cost += _minimise_within_bounds(problem, W, tolerance_n)
    while _remove_excess_friction(rows, problem.friction):
        if cost >= max_cost:
            rows.tresca_bound_n[: rows.n_contacts] = 0.0
        cost += _minimise_within_bounds(problem, W, tolerance_n)
    _lower_coefficients(rows, problem.friction)
    return cost


@kernel
def _set_bounds(rows: ContactRows, friction: FloatArray, share: float) -> None:
    """Bound friction by ``share`` times mu f_n with the present normal forces, and set the coefficients to zero."""
    for row in range(rows.n_contacts):
        if HAS_GAP[rows.law[row]]:
            rows.tresca_bound_n[row] = share * friction[row] * rows.force_n[row, 0]
            rows.friction[row] = 0.0


@kernel
def _minimise_within_bounds(problem: ContactProblem, W: FloatArray, tolerance_n: float) -> int:
    """Minimise the potential with the present bounds on friction; return the cost in sweeps."""
    cost, sweeps = 0, 0
    while sweeps < MAX_SWEEPS_PER_ITERATION:
        cost += take_active_set_steps(problem, W) + 1
        sweeps += 1
        if sweep(problem, W)[0] <= tolerance_n:
            break
    return cost


@kernel
def _remove_excess_friction(rows: ContactRows, friction: FloatArray) -> bool:
    """Set the bound of contacts whose friction is outside its cone to zero; return whether there are any."""
    is_above = False
    for row in range(rows.n_contacts):
        force, limit = rows.force_n[row], friction[row] * rows.force_n[row, 0]
        if HAS_GAP[rows.law[row]] and rows.tresca_bound_n[row] > 0.0 and math.hypot(force[1], force[2]) > limit:
            rows.tresca_bound_n[row] = 0.0
            is_above = True
    return is_above


@kernel
def _lower_coefficients(rows: ContactRows, friction: FloatArray) -> None:
    """Remove the bounds; a contact that slides on a reduced bound gets the coefficient of friction that fits it."""
    for row in range(rows.n_contacts):
        if HAS_GAP[rows.law[row]]:
            force, limit = rows.force_n[row], friction[row] * rows.force_n[row, 0]
            tangential_n = math.hypot(force[1], force[2])
            is_lowered = tangential_n < limit and tangential_n >= ON_THE_LIMIT * rows.tresca_bound_n[row]
            rows.friction[row] = tangential_n / force[0] if is_lowered else friction[row]
            rows.tresca_bound_n[row] = 0.0
