r"""The set of forces that a contact law admits, and the solvers' operations on it, which are the same for all laws.

With :math:`f_n` along the row's first axis and :math:`f_t` along the others, the admissible set is
:math:`l \le f_n \le h` and :math:`|f_t| \le r`, where r is Coulomb's :math:`\mu f_n` or a fixed number; see `laws`.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.contact.laws import (
    HAS_FRICTION,
    IS_DAMPER,
    MAX_COMPRESSION,
    MAX_TANGENTIAL,
    MAX_TENSION,
    NEEDS_LIMIT,
)
from trocar.services.mechanics.contact.problem import ContactProblem, add_unknown, move_by
from trocar.services.mechanics.contact.rows import KEPT, PRESENT, ContactRows

# A force above this fraction of its limit counts as sliding: local solves reach the limit only up to rounding.
ON_THE_LIMIT = 1.0 - 1e-9
# Of 200,000 drawn disks (condition to 1e8, bounds over twelve decades) 0.02 % need more, because a determinant rounds:
# there the force is scaled onto the edge.
_MAX_NEWTON_STEPS = 12
# Relative to the bound: a thousandth of what `ON_THE_LIMIT` allows, so that a force found on the edge slides.
_CLOSE = 1e-12


@kernel
def normal_range(rows: ContactRows, row: int) -> tuple[float, float]:
    """Return the smallest and the largest admissible normal force of a row, in N."""
    law, limit = rows.law[row], rows.force_limit_n[row]
    if NEEDS_LIMIT[law] and limit <= 0.0:
        return 0.0, 0.0
    return -_multiple(MAX_TENSION[law], limit), _multiple(MAX_COMPRESSION[law], limit)


@kernel
def tangential_limit(rows: ContactRows, row: int) -> float:
    """Return r, the largest admissible tangential force (N) of a row with the pressure that bounds its friction."""
    law = rows.law[row]
    r: float = _multiple(MAX_TANGENTIAL[law], rows.force_limit_n[row])
    if HAS_FRICTION[law]:
        r += rows.friction[row] * (
            rows.pressure_n[row] if rows.pressure_n[row] >= 0.0 else max(rows.force_n[row, 0], 0.0)
        )
    return r


@inlined_kernel
def keeps_friction(rows: ContactRows, row: int) -> bool:
    """Return whether the tangential force of a row is given."""
    return bool(HAS_FRICTION[rows.law[row]] and rows.pressure_n[row] <= KEPT)


@inlined_kernel
def limit_slope(rows: ContactRows, row: int) -> float:
    """Return by how much `tangential_limit` grows with the normal force."""
    grows = HAS_FRICTION[rows.law[row]] and rows.pressure_n[row] == PRESENT
    return float(rows.friction[row] if grows else 0.0)


@kernel
def _multiple(count: float, limit: float) -> float:
    return count * max(limit, 0.0) if 0.0 < count < math.inf else count


@kernel
def relax(problem: ContactProblem, W: FloatArray, block: int) -> None:
    """Solve the law of one contact with the others fixed: the normal force, then the tangential force.

    A normal without limits (a bilateral constraint) is eliminated first, so that the block is solved exactly.
    """
    row, rows, motion, force = 3 * block, problem.rows, problem.motion, problem.rows.force_n[block]
    m_0, m_1, m_2, change = motion[row], motion[row + 1], motion[row + 2], problem.change
    (low, high), s_1, s_2 = normal_range(rows, block), 0.0, 0.0
    change[0] = change[1] = change[2] = 0.0
    is_held = low == -math.inf and high == math.inf
    if is_held:
        s_1, s_2 = W[row + 1, row] / W[row, row], W[row + 2, row] / W[row, row]
    else:
        _set_force(force, change, 0, min(max(force[0] - m_0 / W[row, row], low), high))
        m_1 += W[row, row + 1] * change[0]
        m_2 += W[row, row + 2] * change[0]
    if not keeps_friction(rows, block):
        r, f_1, f_2 = tangential_limit(rows, block), 0.0, 0.0
        if r > 0.0:
            a = W[row + 1, row + 1] - s_1 * W[row, row + 1]
            b = W[row + 1, row + 2] - s_1 * W[row, row + 2]
            c = W[row + 2, row + 2] - s_2 * W[row, row + 2]
            r_1 = m_1 - s_1 * m_0 - a * force[1] - b * force[2]
            r_2 = m_2 - s_2 * m_0 - b * force[1] - c * force[2]
            f_1, f_2 = minimise_in_disk(a, b, c, r_1, r_2, r)
        _set_force(force, change, 1, f_1)
        _set_force(force, change, 2, f_2)
    if is_held:
        m_0 += W[row + 1, row] * change[1]
        m_0 += W[row + 2, row] * change[2]
        _set_force(force, change, 0, force[0] - m_0 / W[row, row])
    move_by(problem, W, block, (change[0], change[1], change[2]), is_held)


@kernel
def _set_force(force: FloatArray, change: FloatArray, axis: int, value: float) -> None:
    """Set a component of a contact's force, and store its change."""
    change[axis] = value - force[axis]
    force[axis] = value


@inlined_kernel
def minimise_in_disk(a: float, b: float, c: float, r_1: float, r_2: float, limit: float) -> tuple[float, float]:
    r"""Minimise :math:`\tfrac12 f^T W f + r^T f` over the disk :math:`|f| \le` ``limit``; return both components of f.

    W = ((a, b), (b, c)) is positive definite. Inside the disk the motion W f + r vanishes (stick). On its edge
    W f + r = -lambda f with lambda >= 0, so the slip opposes the force (maximal dissipation). Newton's iteration of
    More and Sorensen (SIAM J. Sci. Stat. Comput. 4, 1983, eq. 3.11) finds lambda: it converges from below.
    """
    shift = 0.0
    f_1, f_2 = 0.0, 0.0
    for _ in range(_MAX_NEWTON_STEPS):
        determinant = (a + shift) * (c + shift) - b * b
        f_1 = (-(c + shift) * r_1 + b * r_2) / determinant
        f_2 = (b * r_1 - (a + shift) * r_2) / determinant
        norm_2 = f_1 * f_1 + f_2 * f_2
        norm = math.sqrt(norm_2)
        if norm <= limit * (1.0 + _CLOSE):
            return f_1, f_2
        g_1 = ((c + shift) * f_1 - b * f_2) / determinant
        g_2 = (-b * f_1 + (a + shift) * f_2) / determinant
        shift += (norm - limit) / limit * norm_2 / (f_1 * g_1 + f_2 * g_2)
    scale = limit / math.sqrt(f_1 * f_1 + f_2 * f_2)
    return scale * f_1, scale * f_2


@kernel
def add_unknowns(problem: ContactProblem, block: int, n: int) -> int:
    """Append the force components of a contact that a Newton step may change; return the new number of unknowns.

    These are the normal force inside its interval, and both tangential components inside the disk; on the edge of the
    disk only the direction across the force. The friction of a sliding contact changes with its normal force.
    """
    rows, row, motion, force = problem.rows, 3 * block, problem.motion, problem.rows.force_n[block]
    low, high = normal_range(rows, block)
    tangential, limit = math.hypot(force[1], force[2]), tangential_limit(rows, block)
    sticks = tangential < ON_THE_LIMIT * limit
    if low < force[0] < high:
        n = add_unknown(problem, n, block, (1.0, 0.0, 0.0), 0.0)
        if limit_slope(rows, block) > 0.0 and not sticks and tangential > 0.0:
            for axis in range(1, 3):
                problem.column[n - 1, axis] = limit_slope(rows, block) * force[axis] / tangential
    if keeps_friction(rows, block):
        return n
    if sticks:
        n = add_unknown(problem, n, block, (0.0, 1.0, 0.0), 0.0)
        return add_unknown(problem, n, block, (0.0, 0.0, 1.0), 0.0)
    if tangential == 0.0:
        return n
    shift = max(-(motion[row + 1] * force[1] + motion[row + 2] * force[2]) / (tangential * tangential), 0.0)
    return add_unknown(problem, n, block, (0.0, -force[2] / tangential, force[1] / tangential), shift)


@kernel
def project(rows: ContactRows, row: int, is_sliding: bool) -> None:
    """Project a force into the admissible set: clamp the normal force, then scale the tangential force down.

    That of a sliding contact is scaled to the edge of the disk from inside, too.
    """
    force, (low, high) = rows.force_n[row], normal_range(rows, row)
    force[0] = min(max(force[0], low), high)
    tangential, limit = math.hypot(force[1], force[2]), tangential_limit(rows, row)
    if keeps_friction(rows, row):
        return
    if tangential > limit or (is_sliding and tangential > 0.0):
        force[1] *= limit / tangential
        force[2] *= limit / tangential


@inlined_kernel
def step_to_bounds(rows: ContactRows, row: int, change: tuple[float, float, float], is_sliding: bool) -> float:
    """Return the largest fraction, at most 1, of a change of force (N) at which the contact neither opens nor slips.

    Opening means that the normal force reaches an end of its interval, slipping that the tangential force reaches the
    edge of the disk, unless it slides already.
    """
    force, (d_0, d_1, d_2), (low, high) = rows.force_n[row], change, normal_range(rows, row)
    fraction, end = 1.0, force[0] + d_0
    if end < low or end > high:
        fraction = max(((low if end < low else high) - force[0]) / d_0, 0.0)
    limit = tangential_limit(rows, row)
    if not (is_sliding or keeps_friction(rows, row)) and 0.0 < limit < math.inf:
        grows = limit_slope(rows, row) * d_0
        a = d_1 * d_1 + d_2 * d_2 - grows * grows
        b = force[1] * d_1 + force[2] * d_2 - limit * grows
        fraction = min(fraction, _step_to_edge(a, b, force[1] ** 2 + force[2] ** 2 - limit * limit))
    return fraction


@inlined_kernel
def _step_to_edge(a: float, b: float, c: float) -> float:
    """Return the first root s of :math:`a s^2 + 2 b s + c`, with ``c`` < 0, or 1 if there is none in (0, 1]."""
    root = b * b - a * c
    if root < 0.0:
        return 1.0
    below = b + math.sqrt(root)
    return min(-c / below, 1.0) if below > 0.0 else 1.0


@kernel
def slides(rows: ContactRows, row: int) -> bool:
    """Return whether a force is on the edge of its disk or, without a disk, at an end of its interval."""
    law, force = rows.law[row], rows.force_n[row]
    if HAS_FRICTION[law] or MAX_TANGENTIAL[law] > 0.0:
        is_pressed = max(force[0], rows.pressure_n[row]) > 0.0 or not HAS_FRICTION[law]
        return bool(is_pressed and math.hypot(force[1], force[2]) >= ON_THE_LIMIT * tangential_limit(rows, row))
    return bool(MAX_TENSION[law] > 0.0 and abs(force[0]) >= ON_THE_LIMIT * normal_range(rows, row)[1])


@kernel
def closed_axes(rows: ContactRows, row: int, is_sliding: bool) -> int:
    """Return how many axes of a row stay closed under a small motion of a body: 0, 1 (the normal) or 3."""
    low, high = normal_range(rows, row)
    if IS_DAMPER[rows.law[row]] or not low < rows.force_n[row, 0] < high:
        return 0
    return 3 if tangential_limit(rows, row) > 0.0 and not is_sliding else 1
