r"""What jaws squeeze: :math:`0 \le u_n + c f_n \perp f_n \ge 0` between both jaws, and nothing along the tangents.

c is the row's softness. u is no gap between surfaces: where a spring between the jaws would carry nothing is in the
row's slip already.
"""

from __future__ import annotations

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.laws.law import ContactProblem, PenaltyGains, Unknowns, add_unknown, carry_change
from services.mechanics.contact.rows import ContactRows

HAS_GAP = False
# A catheter between jaws is never perfectly rigid.
RIGID_SOFTNESS_M_N = 1e-6


@kernel
def open_row(rows: ContactRows, row: int) -> None:
    """Be as good as rigid, until somebody writes a softness."""
    rows.softness_m_n[row] = RIGID_SOFTNESS_M_N


@kernel
def relax(problem: ContactProblem, W: FloatArray, block: int) -> None:
    """Exact normal force with the others fixed; of a force that was recalled from another frame the tangents go."""
    row, force = 3 * block, problem.rows.force_n[block]
    normal = max(0.0, force[0] - problem.motion[row] / W[row, row])
    changes = normal - force[0], -force[1], -force[2]
    force[0], force[1], force[2] = normal, 0.0, 0.0
    for axis in range(3):
        carry_change(problem, W, block, axis, changes[axis])


@kernel
def add_unknowns(problem: ContactProblem, block: int, out: Unknowns, n: int) -> int:
    """Its normal, while it is pressed."""
    if problem.rows.force_n[block, 0] <= 0.0:
        return n
    return add_unknown(out, n, block, (1.0, 0.0, 0.0), 0.0)


@kernel
def project(problem: ContactProblem, block: int) -> None:
    """Push, never pull."""
    force = problem.rows.force_n[block]
    force[0], force[1], force[2] = max(force[0], 0.0), 0.0, 0.0


@kernel
def room(rows: ContactRows, row: int, change: tuple[float, float, float]) -> float:
    """Up to where nothing is squeezed any more."""
    force = rows.force_n[row, 0]
    return force / -change[0] if force + change[0] < 0.0 else 1.0


@kernel
def slides(rows: ContactRows, row: int) -> bool:
    """It has no friction of its own."""
    return False


@kernel
def closed_axes(rows: ContactRows, row: int, is_sliding: bool) -> int:
    """The normal, while it is pressed."""
    return 1 if rows.force_n[row, 0] > 0.0 else 0


@kernel
def penalty(rows: ContactRows, row: int, motion: tuple[float, float, float], gains: PenaltyGains) -> None:
    """Write the force that the law finds where nothing else pushes the jaws.

    Its softness along the tangents, which carry nothing, is that of what is squeezed and of the coupling
    together: stable at any step.
    """
    force = rows.force_n[row]
    force[0], force[1], force[2] = max(0.0, -motion[0] / rows.softness_m_n[row, 1]), 0.0, 0.0
