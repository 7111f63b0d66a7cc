r"""A rod between shut jaws: :math:`u_0 = 0` across them, and along them :math:`u = 0` while :math:`|f_t| \le f_{max}`.

Friction holds it in the plane of the jaws only; it slips there against a force on the edge of a disk. The first axis is
the direction in which the jaws open: one of them is in the way on either side, whatever the force.
"""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.laws import hold
from services.mechanics.contact.laws.ball import bounded_2, way_to_edge
from services.mechanics.contact.laws.law import (
    ON_THE_LIMIT,
    ContactProblem,
    PenaltyGains,
    Unknowns,
    add_axes,
    add_unknown,
    carry_change,
)
from services.mechanics.contact.rows import ContactRows

HAS_GAP = False
FIXES_DISTANCE = True
open_row = hold.open_row


@kernel
def relax(problem: ContactProblem, W: FloatArray, block: int) -> None:
    """No motion across the jaws, nor along them inside the disk of the largest force; slip against the force there.

    Jaws that squeeze no more hold nothing, across neither.
    """
    row, motion, force = 3 * block, problem.motion, problem.rows.force_n[block]
    limit, f_0, f_1, f_2 = problem.rows.force_limit_n[block], 0.0, 0.0, 0.0
    if limit > 0.0:
        r_0, r_1, r_2 = motion[row], motion[row + 1], motion[row + 2]
        for axis in range(3):
            r_0 -= W[row, row + axis] * force[axis]
            r_1 -= W[row + 1, row + axis] * force[axis]
            r_2 -= W[row + 2, row + axis] * force[axis]
        s_1, s_2 = W[row + 1, row] / W[row, row], W[row + 2, row] / W[row, row]
        a = W[row + 1, row + 1] - s_1 * W[row, row + 1]
        b = W[row + 1, row + 2] - s_1 * W[row, row + 2]
        c = W[row + 2, row + 2] - s_2 * W[row, row + 2]
        f_1, f_2 = bounded_2(a, b, c, r_1 - s_1 * r_0, r_2 - s_2 * r_0, limit)
        f_0 = -r_0 / W[row, row] - s_1 * f_1 - s_2 * f_2
    changes = f_0 - force[0], f_1 - force[1], f_2 - force[2]
    force[0], force[1], force[2] = f_0, f_1, f_2
    for axis in range(3):
        carry_change(problem, W, block, axis, changes[axis])


@kernel
def add_unknowns(problem: ContactProblem, block: int, out: Unknowns, n: int) -> int:
    """Three axes while it holds; while it slips, the one across the jaws and that across its force."""
    limit = problem.rows.force_limit_n[block]
    if limit <= 0.0:
        return n
    if not slides(problem.rows, block):
        return add_axes(out, n, block)
    row, motion, force = 3 * block, problem.motion, problem.rows.force_n[block]
    radius = math.hypot(force[1], force[2])
    shift = max(-(motion[row + 1] * force[1] + motion[row + 2] * force[2]) / (radius * radius), 0.0)
    n = add_unknown(out, n, block, (1.0, 0.0, 0.0), 0.0)
    return add_unknown(out, n, block, (0.0, -force[2] / radius, force[1] / radius), shift)


@kernel
def project(problem: ContactProblem, block: int) -> None:
    """Scale the force along the jaws down to the disk; nothing where they squeeze no more."""
    force, limit = problem.rows.force_n[block], problem.rows.force_limit_n[block]
    norm = math.hypot(force[1], force[2])
    if norm > limit:
        force[1] *= limit / norm
        force[2] *= limit / norm
    if limit <= 0.0:
        force[0] = 0.0


@kernel
def slides(rows: ContactRows, row: int) -> bool:
    """Whether the force along the jaws is on the edge of the disk."""
    f = rows.force_n[row]
    return bool(math.hypot(f[1], f[2]) >= ON_THE_LIMIT * rows.force_limit_n[row])


@kernel
def room(rows: ContactRows, row: int, change: tuple[float, float, float]) -> float:
    """Of what is held along the jaws, up to the edge of the disk; across them there is none."""
    force, limit = rows.force_n[row], rows.force_limit_n[row]
    if slides(rows, row):
        return 1.0
    d_1, d_2 = change[1], change[2]
    c = force[1] ** 2 + force[2] ** 2 - limit * limit
    return float(way_to_edge(d_1 * d_1 + d_2 * d_2, force[1] * d_1 + force[2] * d_2, c))


@kernel
def closed_axes(rows: ContactRows, row: int, is_sliding: bool) -> int:
    """All axes while it does not slip, that across the jaws while they squeeze."""
    if rows.force_limit_n[row] <= 0.0:
        return 0
    return 1 if is_sliding else 3


@kernel
def penalty(rows: ContactRows, row: int, motion: tuple[float, float, float], gains: PenaltyGains) -> None:
    """Write the force of a spring between both points, along the jaws up to the limit."""
    force, limit = rows.force_n[row], rows.force_limit_n[row]
    size = gains.stiffness_n_m * math.hypot(motion[1], motion[2])
    scale = -gains.stiffness_n_m * (min(1.0, limit / size) if size > 0.0 else 0.0)
    force[0] = -gains.stiffness_n_m * motion[0] if limit > 0.0 else 0.0
    force[1], force[2] = scale * motion[1], scale * motion[2]
