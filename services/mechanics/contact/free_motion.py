"""Free motion: gaps and slips at the end of the step without contact forces, which the contact laws constrain."""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.collision.pairs import NO_TOOL
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.vectors import row as vector
from trocar.services.mechanics.contact.laws import FIXES_DISTANCE, HAS_GAP
from trocar.services.mechanics.contact.rows import ContactRows, in_frame


@kernel
def subtract_duct_motion(rows: ContactRows, displacement: FloatArray, motion: FloatArray, first: int) -> None:
    """Subtract the duct's displacement from the gaps, and its free motion over the step from the slips.

    A law that fixes a distance constrains positions at the end of the step, so there the slip loses the displacement
    too.

    Args:
        rows: ContactRows. Changed in place.
        displacement, motion: (k, 3) float64. Displacement of the contact points at the start of the step, and their
            free motion over it, in m.
        first: int. First row that is changed.
    """
    for row in range(first, rows.n_contacts):
        for axis in range(3):
            u = displacement[row, axis]
            if HAS_GAP[rows.law[row]]:
                rows.gap_m[row] -= rows.frame[row, 0, axis] * u
            rows.slip_m[row, axis] -= motion[row, axis]
            if FIXES_DISTANCE[rows.law[row]]:
                rows.slip_m[row, axis] -= u


# Largest speed of recovery. It limits overlaps of more than 0.1 mm, which moving contacts do not leave by themselves.
RECOVERY_M_S = 20e-3
# The same for rows with a tool: the hand that holds the tool absorbs the energy. The wall must keep up with closing
# jaws, whose levers turn within a step.
TOOL_RECOVERY_M_S = 0.1


@inlined_kernel
def effective_gap(rows: ContactRows, row: int, recovery: float, dt_s: float) -> float:
    """Return the gap (m) that the law of a row constrains: the distance, or the recovered part of an overlap.

    The fraction ``recovery`` of an overlap is recovered per millisecond. What is beyond ``sunk_m`` no force has made:
    an error of linearisation, or what was there before the contact. It is recovered at a bounded speed.
    """
    gap: float = rows.gap_m[row] + rows.rest_offset_m[row]
    if gap > 0.0:
        return gap
    fastest = RECOVERY_M_S if rows.tool[row] == NO_TOOL else TOOL_RECOVERY_M_S
    share, sunk = min(recovery * (dt_s * 1e3), 1.0), min(rows.sunk_m[row], -gap)
    return float(-share * sunk - min(share * (-gap - sunk), fastest * dt_s))


@inlined_kernel
def sunk_at_end(rows: ContactRows, row: int) -> float:
    """Return how far (m) the force of a row has pressed its surfaces into each other by the end of the step.

    They are a spring beside a damper (Kelvin-Voigt): the force adds its creep, and a part of what was there relaxes. At
    rest it depends on the force alone.
    """
    if not HAS_GAP[rows.law[row]]:
        return 0.0
    return float((1.0 - rows.relaxed) * rows.sunk_m[row] + rows.softness_m_n[row, 0] * rows.force_n[row, 0])


@kernel
def free_motion(rows: ContactRows, recovery: float, dt_s: float, out: FloatArray) -> None:
    """Write the free motion u_free, in the contacts' frames, into ``out`` (3 k,), in m.

    Along the tangents it is the slip plus the elastic slip at the start. Along the normal, if the law has a gap, it is
    the gap at the end of the step, with `effective_gap` and the row's correction for the gap at the start. What a force
    has pressed is no more than the overlap that is left.
    """
    rows.relaxed = min(recovery * (dt_s * 1e3), 1.0)
    for row in range(rows.n_contacts):
        slip = in_frame(rows, row, vector(rows.slip_m, row))
        for axis in range(3):
            total = slip[axis]
            for k in range(3 if axis > 0 else 0):
                total += rows.frame[row, axis, k] * rows.elastic_m[row, k]
            out[3 * row + axis] = total
        rows.effective_gap_m[row] = 0.0
        if HAS_GAP[rows.law[row]]:
            rows.sunk_m[row] = min(rows.sunk_m[row], max(-rows.gap_m[row] - rows.rest_offset_m[row], 0.0))
            rows.effective_gap_m[row] = effective_gap(rows, row, recovery, dt_s) + rows.correction_m[row]
        out[3 * row] += rows.effective_gap_m[row]
