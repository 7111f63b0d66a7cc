r"""Unilateral contact with Coulomb friction: :math:`0 \le u_n \perp f_n \ge 0` and :math:`|f_t| \le \mu f_n`.

Friction is elastoplastic: within the cone :math:`f_t = -e / c` with e the elastic slip, which the contact remembers,
and c the softness of the surfaces. Sliding obeys maximal dissipation: the slip opposes the friction force.

Surfaces that are pressed into each other sink in slowly, and come out of it as overlaps do, by a share of them in a
time (`free_motion.taken_back`): a viscous layer with a spring beside it. With as much in every step, however short, a
force pressed deeper the shorter the steps were.
"""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
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

HAS_GAP = True
ELASTIC_AXES = 2
# A surface is never perfectly rigid; 1 um/N also keeps W positive where contacts are redundant.
SURFACE_SOFTNESS_M_N = 1e-6
# How fast a newton presses surfaces into each other: within 5 ms by 5 um, as deep as it ever does.
SINKS_M_S_N = 1e-3
# Below this sliding speed penalty friction grows in proportion to it: an explicit force cannot stick.
SLIP_SPEED_M_S = 1e-3


@kernel
def open_row(rows: ContactRows, row: int) -> None:
    """Give the surfaces their softness; the contact is frictionless until somebody writes a coefficient."""
    rows.softness_m_n[row] = SURFACE_SOFTNESS_M_N
    rows.softness_m_n[row, 0] = SINKS_M_S_N * rows.dt_s


@kernel
def relax(problem: ContactProblem, W: FloatArray, block: int) -> None:
    """Exact normal force for fixed friction, then exact friction for the new normal force."""
    row, motion, force = 3 * block, problem.motion, problem.rows.force_n[block]
    normal = max(0.0, force[0] - motion[row] / W[row, row])
    change = normal - force[0]
    force[0] = normal
    carry_change(problem, W, block, 0, change)
    radius = problem.rows.friction[block] * normal + problem.rows.rubbing_n[block]
    f_1, f_2 = 0.0, 0.0
    if radius > 0.0:
        a, b, c = W[row + 1, row + 1], W[row + 1, row + 2], W[row + 2, row + 2]
        r_1 = motion[row + 1] - a * force[1] - b * force[2]
        r_2 = motion[row + 2] - b * force[1] - c * force[2]
        f_1, f_2 = bounded_2(a, b, c, r_1, r_2, radius)
    change_1, change_2 = f_1 - force[1], f_2 - force[2]
    force[1], force[2] = f_1, f_2
    carry_change(problem, W, block, 1, change_1)
    carry_change(problem, W, block, 2, change_2)


@kernel
def add_unknowns(problem: ContactProblem, block: int, out: Unknowns, n: int) -> int:
    """The normal of what is pressed; both tangents where it sticks, the direction across its friction where it slides.

    Where friction has a bound of its own there may be some without pressure.
    """
    rows, force = problem.rows, problem.rows.force_n[block]
    limit = rows.friction[block] * force[0] + rows.rubbing_n[block]
    if limit > 0.0 and math.hypot(force[1], force[2]) < ON_THE_LIMIT * limit:
        if force[0] > 0.0:
            return add_axes(out, n, block)
        n = add_unknown(out, n, block, (0.0, 1.0, 0.0), 0.0)
        return add_unknown(out, n, block, (0.0, 0.0, 1.0), 0.0)
    return _add_sliding(problem, block, out, n)


@kernel
def _add_sliding(problem: ContactProblem, block: int, out: Unknowns, n: int) -> int:
    row, motion, mu, force = 3 * block, problem.motion, problem.rows.friction[block], problem.rows.force_n[block]
    f_1, f_2 = force[1], force[2]
    radius_2 = f_1 * f_1 + f_2 * f_2
    radius = math.sqrt(radius_2)
    if force[0] > 0.0:
        n = add_unknown(out, n, block, (1.0, 0.0, 0.0), 0.0)
        if radius > 0.0:
            out.column[n - 1, 1], out.column[n - 1, 2] = mu * f_1 / radius, mu * f_2 / radius
    if radius == 0.0:
        return n
    shift = max(-(motion[row + 1] * f_1 + motion[row + 2] * f_2) / radius_2, 0.0)
    return add_unknown(out, n, block, (0.0, -f_2 / radius, f_1 / radius), shift)


@kernel
def project(problem: ContactProblem, block: int) -> None:
    """Push, never pull, and scale friction down to its cone."""
    force = problem.rows.force_n[block]
    force[0] = max(force[0], 0.0)
    radius = problem.rows.friction[block] * force[0] + problem.rows.rubbing_n[block]
    norm = math.hypot(force[1], force[2])
    if norm > radius:
        force[1] *= radius / norm
        force[2] *= radius / norm


@kernel
def room(rows: ContactRows, row: int, change: tuple[float, float, float]) -> float:
    """Up to where it opens; of what sticks, up to the edge of its cone."""
    force, mu, (d_0, d_1, d_2) = rows.force_n[row], rows.friction[row], change
    share = force[0] / -d_0 if force[0] + d_0 < 0.0 else 1.0
    limit = mu * force[0] + rows.rubbing_n[row]
    if math.hypot(force[1], force[2]) < ON_THE_LIMIT * limit:
        a = d_1 * d_1 + d_2 * d_2 - mu * mu * d_0 * d_0
        b = force[1] * d_1 + force[2] * d_2 - mu * limit * d_0
        share = min(share, way_to_edge(a, b, force[1] ** 2 + force[2] ** 2 - limit * limit))
    return share


@kernel
def slides(rows: ContactRows, row: int) -> bool:
    """Whether a pressed contact has its friction on the cone."""
    f = rows.force_n[row]
    tangent = math.hypot(f[1], f[2])
    return bool(f[0] > 0.0 and tangent >= ON_THE_LIMIT * (rows.friction[row] * f[0] + rows.rubbing_n[row]))


@kernel
def closed_axes(rows: ContactRows, row: int, is_sliding: bool) -> int:
    """All axes of a pressed contact that sticks, the normal of one that slides."""
    if rows.force_n[row, 0] <= 0.0:
        return 0
    return 1 if is_sliding or rows.friction[row] <= 0.0 else 3


@kernel
def penalty(rows: ContactRows, row: int, motion: tuple[float, float, float], gains: PenaltyGains) -> None:
    r"""Write :math:`f_n = \max(0, -k g - c \dot g)` where surfaces overlap, and regularised friction.

    The gap is that in the middle of the step: with the one at its start a force that is held over a step of second
    order feeds energy in at any stiffness. The damper of a particle is at most what halves its speed in a step.
    """
    force, gap = rows.force_n[row], rows.gap_m[row] + rows.pad_m[row] + 0.5 * motion[0]
    damping = gains.damping_n_s_m
    if rows.rod_weight[row, 0] != 0.0 or rows.rod_weight[row, 2] != 0.0:
        damping = min(damping, 0.5 * gains.lightest_kg / gains.dt_s)
    spring, damper = gains.stiffness_n_m * gap, damping * motion[0]
    force[0] = max(0.0, -spring - damper / gains.dt_s) if gap < 0.0 else 0.0
    sliding = math.hypot(motion[1], motion[2])
    scale = rows.friction[row] * force[0] / max(sliding, SLIP_SPEED_M_S * gains.dt_s)
    force[1], force[2] = -scale * motion[1], -scale * motion[2]
