r"""A seal: along the first axis :math:`u = -c f` while :math:`|f| \le f_{max}`, else it slips against that force.

Coulomb's law in one dimension, with an elastic length :math:`c f_{max}`, c being the row's softness: what is taken up
of it already belongs into the row's slip. Nothing acts across the axis.
"""

from __future__ import annotations

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.laws.law import (
    ON_THE_LIMIT,
    ContactProblem,
    PenaltyGains,
    Unknowns,
    add_unknown,
    carry_change,
)
from services.mechanics.contact.rows import ContactRows

HAS_GAP = False
# A lip of rubber: 2 um at 20 mN.
SEAL_SOFTNESS_M_N = 1e-4


@kernel
def open_row(rows: ContactRows, row: int) -> None:
    """Give the lip its softness; it bears every force until somebody writes a limit."""
    rows.softness_m_n[row] = SEAL_SOFTNESS_M_N


@kernel
def relax(problem: ContactProblem, W: FloatArray, block: int) -> None:
    """No motion within the limit, slip against it beyond."""
    row, force, limit = 3 * block, problem.rows.force_n[block], problem.rows.force_limit_n[block]
    wanted = min(max(force[0] - problem.motion[row] / W[row, row], -limit), limit)
    change = wanted - force[0]
    force[0] = wanted
    problem.change[1] = problem.change[2] = 0.0
    carry_change(problem, W, block, 0, change)


@kernel
def add_unknowns(problem: ContactProblem, block: int, out: Unknowns, n: int) -> int:
    """Its axis, while it holds."""
    is_held = abs(problem.rows.force_n[block, 0]) < ON_THE_LIMIT * problem.rows.force_limit_n[block]
    return add_unknown(out, n, block, (1.0, 0.0, 0.0), 0.0) if is_held else n


@kernel
def project(problem: ContactProblem, block: int) -> None:
    """Cut the force at the limit; none across."""
    force, limit = problem.rows.force_n[block], problem.rows.force_limit_n[block]
    force[0] = min(max(force[0], -limit), limit)
    force[1] = force[2] = 0.0


@kernel
def room(rows: ContactRows, row: int, change: tuple[float, float, float]) -> float:
    """Up to the limit."""
    force, limit = rows.force_n[row, 0], rows.force_limit_n[row]
    if abs(force + change[0]) <= limit or abs(force) > limit:
        return 1.0
    return float((limit - force) / change[0] if change[0] > 0.0 else (limit + force) / -change[0])


@kernel
def slides(rows: ContactRows, row: int) -> bool:
    """Whether the force is at the limit."""
    return bool(abs(rows.force_n[row, 0]) >= ON_THE_LIMIT * rows.force_limit_n[row])


@kernel
def closed_axes(rows: ContactRows, row: int, is_sliding: bool) -> int:
    """Its axis, while it holds."""
    return 0 if is_sliding else 1


@kernel
def penalty(rows: ContactRows, row: int, motion: tuple[float, float, float], gains: PenaltyGains) -> None:
    """Write what stops the lightest mass within four steps, up to the limit: an explicit force cannot hold."""
    force, limit = rows.force_n[row], rows.force_limit_n[row]
    brake = 0.25 * gains.lightest_kg / gains.dt_s**2 * motion[0]
    force[0], force[1], force[2] = -min(max(brake, -limit), limit), 0.0, 0.0
