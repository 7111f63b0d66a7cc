r"""Passivity of a step's contacts: they give bodies no more energy than friction, impacts and couplings dissipate.

Forces f that move contact points by u against each other put :math:`f \cdot u` into the bodies. This is negative for a
solution of the contact laws, but for two things: a recovered overlap, whose motion nobody has put in, and a solve that
was cut short. So overlaps are recovered only as far as the same step pays for it: small work entirely, large work up to
a level. A step begins with the payment that the last one could have made, so that jaws that are shut on a wall are
solved once. If this is still too much, because other contacts bear the load then, nothing is recovered: a solve of the
laws alone gives nothing.

Jaws at rest would keep their last micrometres of overlap for ever, which falsify a force by a per cent. So there is a
small credit, a share of the recent work of the hands, which the dissipation of friction and impacts repays.

No limit holds in the first tenth of a second: bodies that overlap when a scene begins, as a wall does that a hand
presses while physics restarts, come apart by the bounded recovery, and are felt from then on.
"""

from __future__ import annotations

import math
from typing import Annotated

from services.mechanics.arrays import FloatArray
from services.mechanics.bodies.forceps.tool_body import ToolArrays
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.struct import Struct
from services.mechanics.contact.laws import ELASTIC_AXES, HAS_GAP
from services.mechanics.contact.problem import ContactProblem
from services.mechanics.contact.rows import ContactRows
from services.mechanics.contact.solver import solve_contacts
from services.mechanics.contact.solver_steps import SolverScratch

# Energy that a step may give without owing it: a ten-thousandth of what a catheter's length holds at a tenth of a metre
# per second. A catheter that lies still on flat triangles gives a sixth of it, as its points change triangles.
SLACK_J = 1e-10
# Share of the work of the hands within `LATELY_S` that may be owed.
CREDIT = 2e-3
LATELY_S = 1.0
# Time after its start in which a scene may separate bodies that overlapped.
BEGINS_S = 0.1
# Share of the dissipation that pays for recovery: with less recovery, friction dissipates less too.
PAID = 0.9
_HALVINGS = 30


class Ledger(Struct):
    """Energy that contacts owe, and the limits on it, in J.

    ``paid_j`` is what the last step could have paid for recovery, infinite if it recovered everything; ``worked_j`` is
    the recent work of the hands, and ``most_j`` its recent maximum. ``begun_s`` is the time with contacts since the
    start, which is over once nothing touches. A step may be solved several times, of which the last counts: ``solves``
    counts them, and ``before`` holds the other entries as they were at the start of the step.
    """

    paid_j: float = math.inf
    owed_j: float = 0.0
    worked_j: float = 0.0
    most_j: float = 0.0
    begun_s: float = 0.0
    before: Annotated[FloatArray, 5]
    solves: int = 0


@inlined_kernel
def solve_passively(
    problem: ContactProblem,
    W: FloatArray,
    effort: tuple[int, float],
    work: tuple[SolverScratch, Ledger],
    hands: tuple[ToolArrays, float],
) -> int:
    """Solve as `solve_contacts`, and again while contacts give more than is paid for; return the number of sweeps.

    ``work`` is (scratch, ledger); ``hands`` are the tools and the length of the step in s.
    """
    rows, (scratch, ledger) = problem.rows, work
    _open(ledger)
    _note_hands(ledger, hands[0], hands[1])
    if ledger.begun_s < BEGINS_S:
        ledger.begun_s += hands[1]
        only: int = solve_contacts(problem, W, effort, scratch)
        return only
    credit_j = max(CREDIT * ledger.most_j - ledger.owed_j, SLACK_J)
    is_less = take_back_at_most(rows, ledger.paid_j + credit_j, problem.motion)
    sweeps: int = solve_contacts(problem, W, effort, scratch)
    over_j = _over_j(problem, hands)
    for attempt in range(2):
        paid_j = PAID * max(work_j(rows) - over_j, 0.0) + credit_j if attempt == 0 else 0.0
        if over_j <= credit_j or not take_back_at_most(rows, paid_j, scratch.free):
            break
        is_less = True
        for place in range(W.shape[0]):
            problem.motion[place] = scratch.free[place]
        sweeps += solve_contacts(problem, W, effort, scratch)
        over_j = _over_j(problem, hands)
    ledger.paid_j = PAID * max(work_j(rows) - over_j, 0.0) if is_less else math.inf
    ledger.owed_j = max(ledger.owed_j + over_j - SLACK_J, 0.0)
    return sweeps


@kernel
def _open(ledger: Ledger) -> None:
    """Save the ledger at the first solve of a step, and restore it at the others."""
    before = ledger.before
    if ledger.solves == 0:
        before[0], before[1], before[2] = ledger.paid_j, ledger.owed_j, ledger.worked_j
        before[3], before[4] = ledger.most_j, ledger.begun_s
    else:
        ledger.paid_j, ledger.owed_j, ledger.worked_j = before[0], before[1], before[2]
        ledger.most_j, ledger.begun_s = before[3], before[4]
    ledger.solves += 1


@kernel
def _note_hands(ledger: Ledger, tools: ToolArrays, dt_s: float) -> None:
    """Enter the work of the hands on the couplings, with the couplings' stretch at the start of the step."""
    kept = max(1.0 - dt_s / LATELY_S, 0.0)
    ledger.worked_j *= kept
    for tool in range(tools.stretch.shape[0]):
        if tools.present[tool]:
            for axis in range(tools.stretch.shape[1]):
                force = tools.stiffness[tool, axis] * tools.stretch[tool, axis]
                ledger.worked_j -= force * (tools.hand[tool, axis] - tools.start[tool, axis])
    ledger.most_j = max(kept * ledger.most_j, abs(ledger.worked_j))


@kernel
def _over_j(problem: ContactProblem, hands: tuple[ToolArrays, float]) -> float:
    """Return the energy (J) that contacts give beyond the couplings' dissipation, which is computed only if needed."""
    given: float = given_j(problem)
    return given - taken_by_couplings_j(problem.rows, hands[0], hands[1]) if given > SLACK_J else given


@kernel
def taken_by_couplings_j(rows: ContactRows, tools: ToolArrays, dt_s: float) -> float:
    """Return the energy (J) that dampers and implicit steps of the couplings dissipate with the solved forces."""
    total = 0.0
    for tool in range(tools.stretch.shape[0]):
        for coordinate in range(tools.stretch.shape[1]):
            load = 0.0
            for row in range(rows.n_contacts):
                if rows.tool[row] == tool:
                    for axis in range(3):
                        for k in range(3):
                            load += rows.lever[row, k, coordinate] * rows.frame[row, axis, k] * rows.force_n[row, axis]
            end = (
                tools.free[tool, coordinate] + tools.compliance[tool, coordinate] * load - tools.hand[tool, coordinate]
            )
            change = end - tools.stretch[tool, coordinate]
            total += (tools.damping[tool, coordinate] / dt_s + 0.5 * tools.stiffness[tool, coordinate]) * change**2
    return total


@kernel
def given_j(problem: ContactProblem) -> float:
    """Return the energy (J) that contacts between surfaces give to bodies and to the springs of their friction."""
    rows, motion, total = problem.rows, problem.motion, 0.0
    for row in range(rows.n_contacts):
        force = rows.force_n[row]
        if not HAS_GAP[rows.law[row]] or force[0] == 0.0:
            continue
        total += force[0] * (motion[3 * row] - rows.softness_m_n[row, 0] * force[0] - rows.taken_m[row])
        total -= rows.held_j[row]
        for axis in range(1, 3):
            softness, started = rows.softness_m_n[row, axis], _elastic_m(rows, row, axis)
            total += force[axis] * (motion[3 * row + axis] - softness * force[axis] - started)
            if axis >= 3 - ELASTIC_AXES[rows.law[row]]:
                total += 0.5 * softness * force[axis] ** 2
    return total


@kernel
def _elastic_m(rows: ContactRows, row: int, axis: int) -> float:
    """Return the elastic slip that a row begins with along an axis of its frame."""
    total = 0.0
    if axis >= 3 - ELASTIC_AXES[rows.law[row]]:
        for k in range(3):
            total += rows.frame[row, axis, k] * rows.elastic_m[row, k]
    return total


@kernel
def take_back_at_most(rows: ContactRows, paid_j: float, free: FloatArray) -> bool:
    """Limit the recovery of overlaps to the work ``paid_j`` (J) of the present forces; return whether any is limited.

    Without payment nothing is recovered, not even where no force acts yet. ``free`` (3 k,) is the motion without
    contact forces, as `free_motion` has written it.
    """
    if 0.0 < paid_j >= work_j(rows):
        return False
    level = _level(rows, paid_j)
    for row in range(rows.n_contacts):
        work, before = _work_j(rows, row), rows.taken_m[row]
        if before < 0.0 and (work > level or paid_j == 0.0):
            rows.taken_m[row] *= level / work if work > 0.0 else 0.0
            free[3 * row] += rows.taken_m[row] - before
    return True


@kernel
def work_j(rows: ContactRows) -> float:
    """Return the work (J) of all rows over the recovery of their overlaps."""
    total = 0.0
    for row in range(rows.n_contacts):
        total += _work_j(rows, row)
    return total


@kernel
def _work_j(rows: ContactRows, row: int) -> float:
    """Return the work (J) of a row over the recovery of its overlap."""
    if not HAS_GAP[rows.law[row]]:
        return 0.0
    work: float = -max(rows.force_n[row, 0], 0.0) * min(rows.taken_m[row], 0.0)
    return work


@kernel
def _level(rows: ContactRows, paid_j: float) -> float:
    """Return the limit (J) on the work of each row at which all rows together do the work that is paid for."""
    low, high = 0.0, paid_j
    for _ in range(_HALVINGS):
        middle, total = 0.5 * (low + high), 0.0
        for row in range(rows.n_contacts):
            total += min(_work_j(rows, row), middle)
        if total > paid_j:
            high = middle
        else:
            low = middle
    return low
