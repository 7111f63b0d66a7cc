r"""Passivity of a step's contacts: they give the bodies no more energy than friction, impacts and couplings dissipate.

Forces f whose contact points move by u relative to each other do the work :math:`f \cdot u` on the bodies. It is
negative for a solution of the contact laws, with two exceptions: the recovery of an overlap, which is a motion that no
force has caused, and a solve that was cut short. So the work of recovery is limited to a budget, which is what the same
step dissipates: rows with little work recover fully, the others up to an equal limit on each. A step begins with the
budget that the last one could have had, so that jaws shut on a wall need one solve only. If this is still too much,
because other contacts bear the load then, nothing is recovered, and the solution of the laws alone is passive.

What a row's own force has pressed its surfaces into each other is no such overlap. They have taken that work, store a
part of it, and give it back. It is in the books and is never limited: surfaces that may not relax creep under a load.

Jaws at rest would keep their last micrometres of overlap for ever, which is an error of one per cent in a force. So
while a tool touches something there is a small credit, a fraction of the recent work of the hands, which friction and
impacts repay. A catheter left alone has none: it would be set swinging for seconds.

There is no limit in the first 25 milliseconds. Bodies may overlap when a scene begins, as a wall does that a hand
presses while physics restarts; they are separated at the bounded speed of recovery.
"""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays
from trocar.services.mechanics.collision.pairs import NO_TOOL
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.compiled.vectors import row as vector
from trocar.services.mechanics.contact.free_motion import sunk_at_end
from trocar.services.mechanics.contact.laws import HAS_FRICTION, HAS_GAP
from trocar.services.mechanics.contact.problem import UNBOUNDED, ContactProblem
from trocar.services.mechanics.contact.rows import ContactRows, in_frame
from trocar.services.mechanics.contact.solver import solve_contacts
from trocar.services.mechanics.contact.sweeps import set_aside

# Energy that a step may add without debt, for rounding. A thousand steps of it, a second, are less than a particle of
# 3.4 mg, as the catheter's are, has at 1 mm/s, which counts as rest: friction or not, nothing is kept swinging.
SLACK_J = 1e-15
# Largest debt, as a fraction of the work of the hands within the last `RECENT_S`: a fifth of what counts as a gain.
CREDIT = 2e-3
RECENT_S = 1.0
# A debt that nobody notices: the work of 1 mN over 1 um, as of the wall's terms.
NOTICED_J = 1e-9
# Time with contacts after the start of a scene in which recovery has no limit: at a fifth per millisecond 0.4 % of an
# overlap is left. A clip that closes, or a hand, would give out energy in more of it.
START_UP_S = 0.025
# Fraction of the dissipation that recovery may use: with less recovery, friction dissipates less too.
BUDGET_SHARE = 0.9
# A limit to 1e-9 of the budget, 2^-30, because the work of a row may be so small a part of it.
_BISECTIONS = 30


class Ledger(Struct):
    """Energy that contacts have added beyond dissipation, and the limits on it.

    A step may be solved several times; only the last solve counts.
    """

    budget_j: float = math.inf  # work of recovery that the last step could have afforded; infinite if all was recovered
    debt_j: float = 0.0  # energy that contacts have added and not yet repaid
    hand_work_j: float = 0.0  # of the hands on the couplings, with exponential forgetting over `RECENT_S`
    max_hand_work_j: float = 0.0  # recent maximum of its magnitude
    contact_time_s: float = 0.0  # time with contacts since the start, or since nothing touched
    at_start: Annotated[FloatArray, 3]  # budget, debt and time at the start of the step
    n_solves: int = 0  # of this step so far


def within_credit(ledger: Ledger) -> bool:
    """Return whether the solves of a step have left no debt beyond the credit, or none beyond that it began with."""
    most_j = max(CREDIT * ledger.max_hand_work_j, NOTICED_J + ledger.at_start[1])
    return bool(ledger.n_solves == 0 or ledger.debt_j <= most_j)


@inlined_kernel
def solve_passively(
    problem: ContactProblem,
    W: FloatArray,
    effort: tuple[int, float],
    ledger: Ledger,
    tools_and_step: tuple[ToolArrays, float],
) -> int:
    """Solve as `solve_contacts`, again with less recovery if contacts add too much energy; return the number of sweeps.

    Each solve leaves a part of the work to those after it.

    ``tools_and_step`` is (tools, length of the step in s).
    """
    rows = problem.rows
    _begin_solve(ledger, tools_and_step[0], tools_and_step[1])
    if ledger.contact_time_s < START_UP_S:
        ledger.contact_time_s += tools_and_step[1]
        return _solve_in_part(problem, W, effort)
    touches_tool = rows.tool[: rows.n_contacts].max() != NO_TOOL
    credit_j = max(CREDIT * ledger.max_hand_work_j - ledger.debt_j, SLACK_J) if touches_tool else SLACK_J
    is_limited = limit_recovery(rows, ledger.budget_j + credit_j, problem.free)
    sweeps = _solve_in_part(problem, W, effort)
    excess_j = _excess_j(problem, tools_and_step)
    for attempt in range(2):
        budget_j = BUDGET_SHARE * max(recovery_work_j(rows) - excess_j, 0.0) + credit_j if attempt == 0 else 0.0
        if excess_j <= credit_j or not limit_recovery(rows, budget_j, problem.free):
            break
        is_limited = True
        sweeps += _solve_in_part(problem, W, effort)
        excess_j = _excess_j(problem, tools_and_step)
    ledger.budget_j = BUDGET_SHARE * max(recovery_work_j(rows) - excess_j, 0.0) if is_limited else math.inf
    ledger.debt_j = max(ledger.debt_j + excess_j - SLACK_J, 0.0)
    return sweeps


@kernel
def _solve_in_part(problem: ContactProblem, W: FloatArray, effort: tuple[int, float]) -> int:
    """Solve as `solve_contacts` with a part of the work that is left, because more solves may follow."""
    kept = set_aside(problem, UNBOUNDED)
    sweeps = solve_contacts(problem, W, effort)
    problem.products_left += kept
    return int(sweeps)


@inlined_kernel
def _begin_solve(ledger: Ledger, tools: ToolArrays, dt_s: float) -> None:
    """Add the work of the hands and save the ledger at the first solve of a step, and restore it at the others."""
    at_start = ledger.at_start
    if ledger.n_solves == 0:
        _add_hand_work(ledger, tools, dt_s)
        at_start[0], at_start[1], at_start[2] = ledger.budget_j, ledger.debt_j, ledger.contact_time_s
    else:
        ledger.budget_j, ledger.debt_j, ledger.contact_time_s = at_start[0], at_start[1], at_start[2]
    ledger.n_solves += 1


@inlined_kernel
def _add_hand_work(ledger: Ledger, tools: ToolArrays, dt_s: float) -> None:
    """Add the work of the hands on the couplings, computed with the couplings' stretch at the start of the step."""
    kept = max(1.0 - dt_s / RECENT_S, 0.0)
    ledger.hand_work_j *= kept
    for tool in range(tools.stretch.shape[0]):
        if tools.present[tool]:
            for axis in range(tools.stretch.shape[1]):
                force = tools.stiffness[tool, axis] * tools.stretch[tool, axis]
                ledger.hand_work_j -= force * (tools.hand[tool, axis] - tools.start[tool, axis])
    ledger.max_hand_work_j = max(kept * ledger.max_hand_work_j, abs(ledger.hand_work_j))


@kernel
def _excess_j(problem: ContactProblem, tools_and_step: tuple[ToolArrays, float]) -> float:
    """Return the energy (J) that contacts add beyond the couplings' dissipation, which is computed only if needed."""
    given = contact_work_j(problem)
    if given <= SLACK_J:
        return given
    return given - coupling_dissipation_j(problem.rows, tools_and_step[0], tools_and_step[1])


@inlined_kernel
def coupling_dissipation_j(rows: ContactRows, tools: ToolArrays, dt_s: float) -> float:
    """Return the energy (J) that the couplings' dampers and implicit steps dissipate with the solved forces."""
    total = 0.0
    for tool in range(tools.stretch.shape[0]):
        for coordinate in range(tools.stretch.shape[1]):
            load = 0.0
            for row in range(rows.n_contacts):
                if rows.tool[row] == tool:
                    for axis in range(3):
                        for k in range(3):
                            load += rows.lever[row, k, coordinate] * rows.frame[row, axis, k] * rows.force_n[row, axis]
            end = tools.free[tool, coordinate] + tools.compliance[tool, coordinate] * load
            change = end - tools.hand[tool, coordinate] - tools.stretch[tool, coordinate]
            total += (tools.damping[tool, coordinate] / dt_s + 0.5 * tools.stiffness[tool, coordinate]) * change**2
    return total


@inlined_kernel
def contact_work_j(problem: ContactProblem) -> float:
    """Return the work (J) that contacts do on the bodies, on their surfaces and on the springs of their friction."""
    rows, motion, total = problem.rows, problem.motion, 0.0
    for row in range(rows.n_contacts):
        force = rows.force_n[row]
        if not HAS_GAP[rows.law[row]] or force[0] == 0.0:
            continue
        total += force[0] * (motion[3 * row] - rows.softness_m_n[row, 0] * force[0] - rows.effective_gap_m[row])
        total += _stored_more_j(rows, row)
        total -= rows.friction_energy_j[row]
        started = in_frame(rows, row, vector(rows.elastic_m, row))
        for axis in range(1, 3):
            softness = rows.softness_m_n[row, axis]
            total += force[axis] * (motion[3 * row + axis] - softness * force[axis] - started[axis])
            if HAS_FRICTION[rows.law[row]]:
                total += 0.5 * softness * force[axis] ** 2
    return total


@kernel
def limit_recovery(rows: ContactRows, budget_j: float, free: FloatArray) -> bool:
    """Limit the recovery of overlaps so that the present forces do at most the work ``budget_j`` (J).

    Return whether any recovery is limited. With a budget of zero nothing is recovered, not even where no force acts
    yet. A correction is no recovery: with it the true gap stays as it is, and the force does no work. Nor is what the
    surfaces relax of what their own force has pressed. ``free`` (3 k,) is the motion without contact forces, as
    `free_motion` has written it; it is updated.
    """
    if 0.0 < budget_j >= recovery_work_j(rows):
        return False
    row_limit_j = _row_work_limit_j(rows, budget_j)
    for row in range(rows.n_contacts):
        work, recovered_m = _row_recovery_work_j(rows, row), _recovered_m(rows, row)
        if recovered_m < 0.0 and (work > row_limit_j or budget_j == 0.0):
            less_m = (1.0 - (row_limit_j / work if work > 0.0 else 0.0)) * recovered_m
            rows.effective_gap_m[row] -= less_m
            free[3 * row] -= less_m
    return True


@kernel
def recovery_work_j(rows: ContactRows) -> float:
    """Return the work (J) of all rows over the recovery of their overlaps."""
    total = 0.0
    for row in range(rows.n_contacts):
        total += _row_recovery_work_j(rows, row)
    return total


@kernel
def _row_recovery_work_j(rows: ContactRows, row: int) -> float:
    """Return the work (J) of a row over the recovery of its overlap."""
    if not HAS_GAP[rows.law[row]]:
        return 0.0
    return float(-max(rows.force_n[row, 0], 0.0) * min(_recovered_m(rows, row), 0.0))


@kernel
def _recovered_m(rows: ContactRows, row: int) -> float:
    """Return what the law of a row constrains (m) beyond corrections and the relaxation of what its force has made."""
    return float(rows.effective_gap_m[row] - rows.correction_m[row] + rows.relaxed * rows.sunk_m[row])


@inlined_kernel
def _stored_more_j(rows: ContactRows, row: int) -> float:
    """Return the energy (J) that the pressed surfaces of a row store more at the end of the step than at its start."""
    start, end = rows.sunk_m[row], sunk_at_end(rows, row)
    return float(0.5 * rows.relaxed / rows.softness_m_n[row, 0] * (end * end - start * start))


@inlined_kernel
def _row_work_limit_j(rows: ContactRows, budget_j: float) -> float:
    """Return the limit (J) on the work of each row at which the work of all rows is the budget, by bisection."""
    low, high = 0.0, budget_j
    for _ in range(_BISECTIONS):
        middle, total = 0.5 * (low + high), 0.0
        for row in range(rows.n_contacts):
            total += min(_row_recovery_work_j(rows, row), middle)
        if total > budget_j:
            high = middle
        else:
            low = middle
    return low
