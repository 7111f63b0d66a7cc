"""Gaps and slips at the end of the step without contact forces: what the laws ask to be zero or positive."""

from __future__ import annotations

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.laws import ELASTIC_AXES, FIXES_DISTANCE
from services.mechanics.contact.rows import ContactRows


@kernel
def subtract_duct_motion(rows: ContactRows, displacement: FloatArray, motion: FloatArray) -> None:
    """Take the duct's displacement out of the gaps, and its free motion over the step out of the slips.

    A law that fixes a distance asks for it at the end of the step, so its slip loses the whole displacement.

    Parameters
    ----------
    rows : ContactRows
    displacement, motion : (k, 3) float64
        Displacement of the contact points at the start of the step and their free motion over it.
    """
    for row in range(rows.n_contacts):
        for axis in range(3):
            u = displacement[row, axis]
            rows.gap_m[row] -= rows.frame[row, 0, axis] * u
            rows.slip_m[row, axis] -= motion[row, axis]
            if FIXES_DISTANCE[rows.law[row]]:
                rows.slip_m[row, axis] -= u


@kernel
def free_motion(rows: ContactRows, recovery: float, out: FloatArray) -> None:
    """Write what the contact law asks to be zero or positive without contact forces into ``out`` (3 k,), in m.

    Tangents: the slip, on top of the elastic slip that is remembered.
    Normal: the gap at the end of the step. An overlap at the start is a linearisation error of the last tick;
    only the fraction ``recovery`` of it is taken back per tick, because all of it at once would be a velocity.
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
        gap = rows.gap_m[row]
        out[3 * row] += gap if gap > 0.0 else recovery * gap
