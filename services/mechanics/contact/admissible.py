r"""The set of forces that a contact's law admits, and the operations of the solvers on it, alike for all laws.

With :math:`f_n` along the row's first axis and :math:`f_t` along the others the set is :math:`l \le f_n \le h` and
:math:`|f_t| \le r`, where r is Coulomb's :math:`\mu f_n` or a fixed number; see `laws`.
"""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.laws import HAS_FRICTION, IS_DAMPER, NEEDS_LIMIT, PULLS, PUSHES, RUBS
from services.mechanics.contact.problem import ContactProblem, Unknowns, add_unknown, give
from services.mechanics.contact.rows import ContactRows

# The local solves set a sliding force to its limit up to rounding; a force above this share of it counts as sliding.
ON_THE_LIMIT = 1.0 - 1e-9
_NEWTON_STEPS = 12
_CLOSE = 1e-12


@kernel
def normal_range(rows: ContactRows, row: int) -> tuple[float, float]:
    """Return the least and the largest normal force of a row."""
    law, limit = rows.law[row], rows.force_limit_n[row]
    if NEEDS_LIMIT[law] and limit <= 0.0:
        return 0.0, 0.0
    return -_multiple(PULLS[law], limit), _multiple(PUSHES[law], limit)


@kernel
def radius(rows: ContactRows, row: int) -> float:
    """Return the largest force along the surface of a row, with its present normal force."""
    law = rows.law[row]
    r: float = _multiple(RUBS[law], rows.force_limit_n[row])
    if HAS_FRICTION[law]:
        r += rows.friction[row] * max(rows.force_n[row, 0], 0.0) + rows.rubbing_n[row]
    return r


@kernel
def _multiple(count: float, limit: float) -> float:
    return count * max(limit, 0.0) if 0.0 < count < math.inf else count


@kernel
def relax(problem: ContactProblem, W: FloatArray, block: int) -> None:
    """Solve the law of one contact with the others fixed: the normal force, then the force along the surface.

    A contact that is held along its normal at any force is solved exactly: its normal is eliminated first.
    """
    row, rows, motion, force = 3 * block, problem.rows, problem.motion, problem.rows.force_n[block]
    low, high = normal_range(rows, block)
    s_1, s_2 = 0.0, 0.0
    is_held = low == -math.inf and high == math.inf
    if is_held:
        s_1, s_2 = W[row + 1, row] / W[row, row], W[row + 2, row] / W[row, row]
    else:
        normal = min(max(force[0] - motion[row] / W[row, row], low), high)
        give(problem, W, block, 0, normal)
    r, f_1, f_2 = radius(rows, block), 0.0, 0.0
    if r > 0.0:
        a = W[row + 1, row + 1] - s_1 * W[row, row + 1]
        b = W[row + 1, row + 2] - s_1 * W[row, row + 2]
        c = W[row + 2, row + 2] - s_2 * W[row, row + 2]
        r_1 = motion[row + 1] - s_1 * motion[row] - a * force[1] - b * force[2]
        r_2 = motion[row + 2] - s_2 * motion[row] - b * force[1] - c * force[2]
        f_1, f_2 = bounded(a, b, c, r_1, r_2, r)
    give(problem, W, block, 1, f_1)
    give(problem, W, block, 2, f_2)
    if is_held:
        give(problem, W, block, 0, force[0] - motion[row] / W[row, row])


@kernel
def bounded(a: float, b: float, c: float, r_1: float, r_2: float, most: float) -> tuple[float, float]:
    r"""Minimise :math:`\tfrac12 f^T W f + r^T f` over :math:`|f| \le` ``most``, W = ((a, b), (b, c)) positive.

    Inside the disk the motion W f + r vanishes (stick); on its edge W f + r = -lambda f with lambda >= 0, so
    the slip opposes the force (maximal dissipation). lambda by More and Sorensen's Newton iteration (SIAM J.
    Sci. Stat. Comput. 4, 1983, eq. 3.11), which converges from below without overshooting.
    """
    shift = 0.0
    f_1, f_2 = 0.0, 0.0
    for _ in range(_NEWTON_STEPS):
        determinant = (a + shift) * (c + shift) - b * b
        f_1 = (-(c + shift) * r_1 + b * r_2) / determinant
        f_2 = (b * r_1 - (a + shift) * r_2) / determinant
        norm_2 = f_1 * f_1 + f_2 * f_2
        norm = math.sqrt(norm_2)
        if norm <= most * (1.0 + _CLOSE):
            return f_1, f_2
        g_1 = ((c + shift) * f_1 - b * f_2) / determinant
        g_2 = (-b * f_1 + (a + shift) * f_2) / determinant
        shift += (norm - most) / most * norm_2 / (f_1 * g_1 + f_2 * g_2)
    scale = most / math.sqrt(f_1 * f_1 + f_2 * f_2)
    return scale * f_1, scale * f_2


@kernel
def add_unknowns(problem: ContactProblem, block: int, out: Unknowns, n: int) -> int:
    """List the force components of a contact that a Newton step may change, and return the new number of unknowns.

    These are the normal inside its interval, and both tangents inside the disk; on the edge of the disk only the
    direction across the force. The friction of a sliding contact changes with its normal force.
    """
    rows, row, motion, force = problem.rows, 3 * block, problem.motion, problem.rows.force_n[block]
    low, high = normal_range(rows, block)
    rubs, most = math.hypot(force[1], force[2]), radius(rows, block)
    sticks = rubs < ON_THE_LIMIT * most
    if low < force[0] < high:
        n = add_unknown(out, n, block, (1.0, 0.0, 0.0), 0.0)
        if HAS_FRICTION[rows.law[block]] and not sticks and rubs > 0.0:
            for axis in range(1, 3):
                out.column[n - 1, axis] = rows.friction[block] * force[axis] / rubs
    if sticks:
        n = add_unknown(out, n, block, (0.0, 1.0, 0.0), 0.0)
        return add_unknown(out, n, block, (0.0, 0.0, 1.0), 0.0)
    if rubs == 0.0:
        return n
    shift = max(-(motion[row + 1] * force[1] + motion[row + 2] * force[2]) / (rubs * rubs), 0.0)
    return add_unknown(out, n, block, (0.0, -force[2] / rubs, force[1] / rubs), shift)


@kernel
def project(rows: ContactRows, row: int) -> None:
    """Put a force back into the set: cut the normal force off, then scale the force along the surface down."""
    force, (low, high) = rows.force_n[row], normal_range(rows, row)
    force[0] = min(max(force[0], low), high)
    rubs, most = math.hypot(force[1], force[2]), radius(rows, row)
    if rubs > most:
        force[1] *= most / rubs
        force[2] *= most / rubs


@kernel
def room(rows: ContactRows, row: int, change: tuple[float, float, float]) -> float:
    """Return the largest share, at most 1, of a change of the force at which the contact neither opens nor slips."""
    force, (d_0, d_1, d_2), (low, high) = rows.force_n[row], change, normal_range(rows, row)
    share, end = 1.0, force[0] + d_0
    if end < low or end > high:
        share = max(((low if end < low else high) - force[0]) / d_0, 0.0)
    most = radius(rows, row)
    if most < math.inf and math.hypot(force[1], force[2]) < ON_THE_LIMIT * most:
        grows = rows.friction[row] * d_0 if HAS_FRICTION[rows.law[row]] else 0.0
        a = d_1 * d_1 + d_2 * d_2 - grows * grows
        b = force[1] * d_1 + force[2] * d_2 - most * grows
        share = min(share, _way_to_edge(a, b, force[1] ** 2 + force[2] ** 2 - most * most))
    return share


@kernel
def _way_to_edge(a: float, b: float, c: float) -> float:
    """Return the s in (0, 1] at which :math:`a s^2 + 2 b s + c` comes to zero from ``c`` < 0; 1 if that is beyond."""
    root = b * b - a * c
    if root < 0.0:
        return 1.0
    below = b + math.sqrt(root)
    return min(-c / below, 1.0) if below > 0.0 else 1.0


@kernel
def slides(rows: ContactRows, row: int) -> bool:
    """Return whether a force is on the edge of its disk or, without a disk, at an end of its interval."""
    law, force = rows.law[row], rows.force_n[row]
    if HAS_FRICTION[law] or RUBS[law] > 0.0:
        is_pressed = force[0] > 0.0 or not HAS_FRICTION[law]
        return bool(is_pressed and math.hypot(force[1], force[2]) >= ON_THE_LIMIT * radius(rows, row))
    return bool(PULLS[law] > 0.0 and abs(force[0]) >= ON_THE_LIMIT * normal_range(rows, row)[1])


@kernel
def closed_axes(rows: ContactRows, row: int, is_sliding: bool) -> int:
    """Return how many of the three axes stay closed when a body is moved a little: 0, 1 (normal) or 3."""
    low, high = normal_range(rows, row)
    if IS_DAMPER[rows.law[row]] or not low < rows.force_n[row, 0] < high:
        return 0
    return 3 if radius(rows, row) > 0.0 and not is_sliding else 1
