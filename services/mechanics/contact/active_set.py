r"""The primal active-set method (Nocedal and Wright, "Numerical Optimization", 16.5), with one factorisation.

A Newton step is valid up to the point where a contact opens, or slips. There the forces stop, and the others go on.
Sweeps between such sequences close the contacts that are missing; they would also close again what a single step opens.

The rest of a step need not be solved anew. With A x = b the full step, a contact that opens or slips adds *constraints*
g . x = c, which *replace* equations: these get residuals y, along e. So :math:`x = A^{-1} (b - E y)` with
:math:`(G A^{-1} E)\, y = G A^{-1} b - c` (a Schur complement), at the cost of a substitution for each constraint.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.dense import factorise, solve_factorised
from trocar.services.mechanics.compiled.vectors import along, copy_rows, put_row
from trocar.services.mechanics.compiled.vectors import row as vector
from trocar.services.mechanics.contact.admissible import limit_slope, normal_range, project, slides, step_to_bounds
from trocar.services.mechanics.contact.newton import (
    can_pay,
    complete_response,
    cost_in_sweeps,
    list_unknowns,
    n_unknowns_of,
    products_of_factors,
    solve_newton_step,
)
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.sweeps import can_sweep, sweep, update_motion

# Cost in sweeps after which a sequence ends, and sweeps look for missing contacts.
MAX_COST = 30
# A step goes beyond the point where a contact opens or slips by this fraction, so that it does so in spite of rounding.
OVERSHOOT = 1e-9
# What bounds a force in the rest of a step: nothing, the edge of its disk from the start or since it slips, an end of
# its interval.
NO_BOUND, SLIDES, AT_EDGE, AT_END = 0, 1, 2, 3
REJECTED, DESCENDED, SOLVED = 0, 1, 2


@kernel
def take_newton_steps(problem: ContactProblem, W: FloatArray, tolerance_n: float, sweeps: int) -> tuple[int, bool]:
    """Try a full step and a sweep, or take steps that are cut where contacts open or slip.

    The full step is kept if the potential 1/2 f W f + f u_free falls below ``lowest_j``, the lowest of this solve;
    otherwise step and sweep could alternate for ever. Where forces grow a thousandfold from one sweep to the next, as
    when jaws close, only a sweep knows the new directions of friction. Directly after the first sweep it is not tried.
    ``sweeps`` is the cost so far. Return the cost in sweeps, and whether a sweep changed no force by more than the
    tolerance.
    """
    n = list_unknowns(problem)
    if n == 0 or not solve_newton_step(problem, W, n):
        return 0, False
    cost, outcome = cost_in_sweeps(n, problem.rows.n_contacts), REJECTED
    if sweeps > 1:
        cost, outcome = cost + 1, _try_full_step(problem, W, n, tolerance_n)
    if outcome == REJECTED:
        cost = _take_cut_steps(problem, W, n, cost)
    return cost, outcome == SOLVED


@kernel
def _take_cut_steps(problem: ContactProblem, W: FloatArray, n: int, cost: int) -> int:
    """Take cut steps until one in which no contact began to slip, the first one solved; return the increased cost.

    A contact that slips rotates its friction, which its constraint does not know.
    """
    k = problem.rows.n_contacts
    while True:
        cost = _take_step(problem, n, cost)
        update_motion(problem, W)
        has_slipped = False
        for block in range(k):
            has_slipped |= problem.bound[block] == AT_EDGE
        if cost >= MAX_COST or not has_slipped or not can_sweep(problem):
            return cost
        n = list_unknowns(problem)
        if n == 0 or not solve_newton_step(problem, W, n):
            return cost
        cost += cost_in_sweeps(n, k)


@kernel
def _try_full_step(problem: ContactProblem, W: FloatArray, n: int, tolerance_n: float) -> int:
    """Take the full step and a sweep, and return to the forces before if the potential is not the lowest then."""
    k = problem.rows.n_contacts
    problem.lowest_j = min(problem.lowest_j, _potential_j(problem))
    copy_rows(problem.rows.force_n, problem.begun_n, k)
    problem.bound[:k] = NO_BOUND
    _add_step(problem, n, 1.0)
    update_motion(problem, W)
    if sweep(problem, W)[0] <= tolerance_n:
        return SOLVED
    reached_j = _potential_j(problem)
    if reached_j < problem.lowest_j:
        problem.lowest_j = reached_j
        return DESCENDED
    copy_rows(problem.begun_n, problem.rows.force_n, k)
    problem.moved[:n] = 0.0
    update_motion(problem, W)
    return REJECTED


@kernel
def _potential_j(problem: ContactProblem) -> float:
    """Return 1/2 f W f + f u_free in J."""
    total, force, motion, free = 0.0, problem.rows.force_n, problem.motion, problem.free
    for block in range(problem.rows.n_contacts):
        for axis in range(3):
            total += 0.5 * force[block, axis] * (motion[3 * block + axis] + free[3 * block + axis])
    return total


@kernel
def _take_step(problem: ContactProblem, n: int, cost: int) -> int:
    """Take a Newton step of n unknowns to where a contact opens or slips, then its rest; return the increased cost."""
    for block in range(problem.rows.n_contacts):
        problem.bound[block] = SLIDES if slides(problem.rows, block) else NO_BOUND
    while True:
        fraction = _feasible_fraction(problem, n)
        _add_step(problem, n, min(fraction * (1.0 + OVERSHOOT), 1.0))
        if fraction >= 1.0 or cost >= MAX_COST or not _note_bounds(problem, n):
            return cost
        if not _solve_constrained_step(problem, n, _list_constraints(problem, n)):
            return cost
        cost += 1


@kernel
def _feasible_fraction(problem: ContactProblem, n: int) -> float:
    """Return the largest fraction of the step, at most 1, at which no contact opens or slips."""
    rows, change, fraction = problem.rows, problem.force_change, 1.0
    change[: rows.n_contacts] = 0.0
    for i in range(n):
        block = problem.block[i]
        put_row(change, block, along(vector(change, block), vector(problem.column, i), problem.step[i]))
    for block in range(rows.n_contacts):
        bound = problem.bound[block]
        if bound != AT_END:
            fraction = min(fraction, step_to_bounds(rows, block, vector(change, block), bound != NO_BOUND))
    return fraction


@kernel
def _add_step(problem: ContactProblem, n: int, fraction: float) -> None:
    """Add a fraction of the step to the forces, and project the force of every contact into the set of its law."""
    rows = problem.rows
    for i in range(n):
        force = vector(rows.force_n, problem.block[i])
        put_row(rows.force_n, problem.block[i], along(force, vector(problem.column, i), fraction * problem.step[i]))
        problem.moved[i] += fraction * problem.step[i]
    for block in range(rows.n_contacts):
        project(rows, block, problem.bound[block] == SLIDES or problem.bound[block] == AT_EDGE)


@kernel
def _note_bounds(problem: ContactProblem, n: int) -> bool:
    """Note contacts whose force has come to an end of its interval or begun to slip; return if there are any."""
    rows, bound, i, is_new = problem.rows, problem.bound, 0, False
    while i < n:
        block, count = problem.block[i], n_unknowns_of(problem, i, n)
        low, high = normal_range(rows, block)
        if bound[block] != AT_END and problem.test[i, 0] != 0.0 and not low < rows.force_n[block, 0] < high:
            bound[block], is_new = AT_END, True
        elif bound[block] == NO_BOUND and count == 3 and slides(rows, block):
            bound[block], is_new = AT_EDGE, True
        i += count
    return is_new


@kernel
def _list_constraints(problem: ContactProblem, n: int) -> int:
    r"""List the constraints on the rest of the step, with weights on three unknowns each, and return their number.

    A force at an end of its interval stays. One on the edge of the disk stays there: :math:`\hat t \cdot x_t = \mu x_n`
    in place of the equation along :math:`\hat t`.
    """
    m, i, rows = 0, 0, problem.rows
    while i < n:
        block, count = problem.block[i], n_unknowns_of(problem, i, n)
        if problem.bound[block] == AT_END:
            for unknown in range(i, i + count):
                problem.first[m] = unknown
                put_row(problem.constraint, m, (1.0, 0.0, 0.0))
                put_row(problem.replaced, m, (1.0, 0.0, 0.0))
                m += 1
        elif problem.bound[block] == AT_EDGE:
            size = math.hypot(rows.force_n[block, 1], rows.force_n[block, 2])
            t_1, t_2 = rows.force_n[block, 1] / size, rows.force_n[block, 2] / size
            mu = limit_slope(rows, block)
            problem.first[m] = i
            put_row(problem.constraint, m, (-mu, t_1, t_2))
            put_row(problem.replaced, m, (0.0, t_1, t_2))
            m += 1
        i += count
    return m


@kernel
def _solve_constrained_step(problem: ContactProblem, n: int, m: int) -> bool:
    """Write the rest of the step with m constraints; return False if they depend on each other, or no work is left."""
    first, step, replaced = problem.first, problem.step, problem.replaced
    response, residual = problem.response[: n * n].reshape(n, n), problem.residual[:m]
    for i in range(n):
        step[i] = problem.full[i] - problem.moved[i]
    for b in range(m):
        for j in range(3):
            if replaced[b, j] != 0.0 and not complete_response(problem, n, first[b] + j):
                return False
    if not can_pay(problem, m * m + products_of_factors(m)):
        return False
    M = problem.schur[: m * m].reshape(m, m)
    _fill_schur_complement(problem, response, M, residual)
    if not factorise(M, problem.schur_pivots):
        return False
    solve_factorised(M, problem.schur_pivots, residual)
    for b in range(m):
        for j in range(3):
            weight = residual[b] * replaced[b, j]
            if weight != 0.0:
                for i in range(n):
                    step[i] -= weight * response[first[b] + j, i]
    for b in range(m):
        if problem.bound[problem.block[first[b]]] == AT_END:
            step[first[b]] = 0.0  # in spite of rounding
    return True


@kernel
def _fill_schur_complement(problem: ContactProblem, response: FloatArray, M: FloatArray, out: FloatArray) -> None:
    """Fill M (m, m), by columns, and the right-hand side ``out`` (m,) for constraints that keep their value."""
    first, constraint, replaced = problem.first, problem.constraint, problem.replaced
    for a in range(M.shape[0]):
        out[a] = 0.0
        M[:, a] = 0.0
        for i in range(3):
            if constraint[a, i] == 0.0:
                continue
            unknown = first[a] + i
            out[a] += constraint[a, i] * problem.step[unknown]
            for b in range(M.shape[0]):
                for j in range(3):
                    if replaced[b, j] != 0.0:
                        M[b, a] += constraint[a, i] * replaced[b, j] * response[first[b] + j, unknown]
