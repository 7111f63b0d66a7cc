r"""A bilateral hold: :math:`u = 0` while :math:`|f| \le f_{max}`, else slip against a force on its edge."""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.frames import tangents
from services.mechanics.contact.laws.ball import relax_in_ball, way_to_edge
from services.mechanics.contact.laws.law import (
    ON_THE_LIMIT,
    ContactProblem,
    PenaltyGains,
    Unknowns,
    add_axes,
    add_unknown,
)
from services.mechanics.contact.rows import ContactRows

HAS_GAP = False
FIXES_DISTANCE = True
# Pads of the jaws and the catheter's wall give way; held points do not fight over rounding.
GRIP_SOFTNESS_M_N = 1e-4


@kernel
def open_row(rows: ContactRows, row: int) -> None:
    """Give the grip its softness; it bears every force until somebody writes a limit."""
    rows.softness_m_n[row] = GRIP_SOFTNESS_M_N


@kernel
def relax(problem: ContactProblem, W: FloatArray, block: int) -> None:
    """No motion inside the ball of the largest force, slip against the force on its edge."""
    relax_in_ball(problem, W, block, problem.rows.force_limit_n[block])


@kernel
def add_unknowns(problem: ContactProblem, block: int, out: Unknowns, n: int) -> int:
    """Three axes while it holds, the two directions across its force while it slips."""
    limit = problem.rows.force_limit_n[block]
    if limit <= 0.0:
        return n
    row, force, motion = 3 * block, problem.rows.force_n[block], problem.motion
    x, y, z = force[0], force[1], force[2]
    radius_2 = x * x + y * y + z * z
    radius = math.sqrt(radius_2)
    if radius < ON_THE_LIMIT * limit:
        return add_axes(out, n, block)
    shift = max(-(motion[row] * x + motion[row + 1] * y + motion[row + 2] * z) / radius_2, 0.0)
    first, second = tangents(x / radius, y / radius, z / radius)
    n = add_unknown(out, n, block, first, shift)
    return add_unknown(out, n, block, second, shift)


@kernel
def project(problem: ContactProblem, block: int) -> None:
    """Scale the force down to the ball."""
    force, limit = problem.rows.force_n[block], problem.rows.force_limit_n[block]
    norm = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
    if norm > limit:
        for axis in range(3):
            force[axis] *= limit / norm


@kernel
def slides(rows: ContactRows, row: int) -> bool:
    """Whether the force is on the ball."""
    f = rows.force_n[row]
    return bool(math.hypot(f[0], math.hypot(f[1], f[2])) >= ON_THE_LIMIT * rows.force_limit_n[row])


@kernel
def room(rows: ContactRows, row: int, change: tuple[float, float, float]) -> float:
    """Of what holds, up to the edge of the ball."""
    force, limit = rows.force_n[row], rows.force_limit_n[row]
    if slides(rows, row):
        return 1.0
    a, b, c = 0.0, 0.0, -limit * limit
    for axis in range(3):
        a += change[axis] ** 2
        b += force[axis] * change[axis]
        c += force[axis] ** 2
    return float(way_to_edge(a, b, c))


@kernel
def closed_axes(rows: ContactRows, row: int, is_sliding: bool) -> int:
    """All axes while it does not slip."""
    return 0 if is_sliding or rows.force_limit_n[row] <= 0.0 else 3


@kernel
def penalty(rows: ContactRows, row: int, motion: tuple[float, float, float], gains: PenaltyGains) -> None:
    """Write the force of a spring between both points, up to the limit."""
    force = rows.force_n[row]
    size = gains.stiffness_n_m * math.sqrt(motion[0] ** 2 + motion[1] ** 2 + motion[2] ** 2)
    scale = -gains.stiffness_n_m * (min(1.0, rows.force_limit_n[row] / size) if size > 0.0 else 0.0)
    force[0], force[1], force[2] = scale * motion[0], scale * motion[1], scale * motion[2]
