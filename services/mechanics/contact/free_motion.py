"""Gaps and slips at the end of the step without contact forces, which the contact laws constrain."""

from __future__ import annotations

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.pairs import NO_TOOL
from services.mechanics.compiled import kernel
from services.mechanics.contact.laws import ELASTIC_AXES, FIXES_DISTANCE, HAS_GAP
from services.mechanics.contact.rows import ContactRows


@kernel
def subtract_duct_motion(rows: ContactRows, displacement: FloatArray, motion: FloatArray, first: int) -> None:
    """Subtract the duct's displacement from the gaps, and its free motion over the step from the slips.

    A law that fixes a distance constrains it at the end of the step, so its slip loses the whole displacement.

    Args:
        displacement, motion: (k, 3) float64. Displacement of the contact points at the start of the step and their free
            motion over it.
        first: int. Rows before this one are left as they are.
    """
    for row in range(first, rows.n_contacts):
        for axis in range(3):
            u = displacement[row, axis]
            if HAS_GAP[rows.law[row]]:
                rows.gap_m[row] -= rows.frame[row, 0, axis] * u
            rows.slip_m[row, axis] -= motion[row, axis]
            if FIXES_DISTANCE[rows.law[row]]:
                rows.slip_m[row, axis] -= u


# An overlap of up to 0.1 mm, more than contacts in motion leave, is recovered at its own rate; a deeper one, which
# something drove in, no faster than this.
RECOVERY_M_S = 20e-3
# A hand holds the tool that a wall pushes back, and absorbs the energy; the tool must not lag behind closing jaws,
# whose levers turn within a step.
TOOL_RECOVERY_M_S = 0.1


@kernel
def taken_back(rows: ContactRows, row: int, recovery: float, dt_s: float) -> float:
    """Return the part of a row's gap (m) that counts in a step: all of a distance, the recovered part of an overlap.

    An overlap at the start is a linearisation error of the last tick. Only the fraction ``recovery`` of it is recovered
    per millisecond, and at a bounded speed, because this is a velocity that nobody has put in.
    """
    gap: float = rows.gap_m[row] + rows.rest_offset_m[row]
    if gap > 0.0:
        return gap
    fastest = RECOVERY_M_S if rows.tool[row] == NO_TOOL else TOOL_RECOVERY_M_S
    return max(min(recovery * (dt_s * 1e3), 1.0) * gap, -fastest * dt_s)


@kernel
def free_motion(rows: ContactRows, recovery: float, dt_s: float, out: FloatArray) -> None:
    """Write gaps and slips without contact forces, which the contact laws constrain, into ``out`` (3 k,), in m.

    Along the tangents this is the slip plus the elastic slip at the start. Along the normal it is the gap at the end of
    the step if the law has a gap; of an overlap it is the part that `taken_back` returns.
    """
    for row in range(rows.n_contacts):
        for axis in range(3):
            total = 0.0
            for k in range(3):
                total += rows.frame[row, axis, k] * rows.slip_m[row, k]
            if axis >= 3 - ELASTIC_AXES[rows.law[row]]:
                for k in range(3):
                    total += rows.frame[row, axis, k] * rows.elastic_m[row, k]
            out[3 * row + axis] = total
        if HAS_GAP[rows.law[row]]:
            rows.taken_m[row] = taken_back(rows, row, recovery, dt_s)
            out[3 * row] += rows.taken_m[row]
