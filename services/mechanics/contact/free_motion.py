"""Gaps and slips at the end of the step without contact forces: what the laws ask to be zero or positive."""

from __future__ import annotations

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.laws import FIXES_DISTANCE
from services.mechanics.contact.rows import ContactRows


@kernel
def subtract_duct_motion(
    rows: ContactRows, modes: FloatArray, q: FloatArray, dq: FloatArray, offset: FloatArray, change: FloatArray
) -> None:
    """Take the duct's displacement out of the gaps, and its free motion over the step out of the slips.

    A law that fixes a distance asks for it at the end of the step, so its slip loses the whole displacement.

    Parameters
    ----------
    rows : ContactRows
    modes : (3 k, r) float64
        The modes' rows at the contact points.
    q, dq : (r,) float64
        Modal coordinates at the start of the step and their free change over it.
    offset, change : (k, 3) float64
        Displacement at the start that is not in q (the residual), and its free change over the step.
    """
    for row in range(rows.n_contacts):
        for axis in range(3):
            u, du = 0.0, 0.0
            for mode in range(q.shape[0]):
                u += modes[3 * row + axis, mode] * q[mode]
                du += modes[3 * row + axis, mode] * dq[mode]
            rows.gap_m[row] -= rows.frame[row, 0, axis] * (u + offset[row, axis])
            rows.slip_m[row, axis] -= du + change[row, axis]
            if FIXES_DISTANCE[rows.law[row]]:
                rows.slip_m[row, axis] -= u + offset[row, axis]


@kernel
def free_motion(rows: ContactRows, recovery: float, out: FloatArray) -> None:
    """Write what the contact law asks to be zero or positive without contact forces into ``out`` (3 k,), in m.

    Normal: the gap at the end of the step. An overlap at the start is a linearisation error of the last tick;
    only the fraction ``recovery`` of it is taken back per tick, because all of it at once would be a velocity.
    """
    for row in range(rows.n_contacts):
        for axis in range(3):
            total = 0.0
            for k in range(3):
                total += rows.frame[row, axis, k] * rows.slip_m[row, k]
            out[3 * row + axis] = total
        gap = rows.gap_m[row]
        out[3 * row] += gap if gap > 0.0 else recovery * gap
