r"""A catheter that slips towards the hinge opens the jaws that hold it: they are a wedge, and it is as thick as it was.

At a distance s from the hinge the axes of both jaws are :math:`2 s \sin(\theta / 2)` apart, and the catheter needs as
much room there as in the grasp. One row ties both: a force that the catheter bears towards the tips, and with which,
by virtual work, it opens the jaws. So what opens them is what pushes it in, and nothing is gained: a step takes out as
much of the one as it gives to the other. Jaws with room left are not touched.

What turns within a step leaves a little less room than there was: that much is let in, never taken back, which would be
motion that nobody has put in.
"""

from __future__ import annotations

from services.mechanics.collision.pairs import CATHETER_SEGMENT, JAW_A, SHAFT
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.vectors import (
    Vector,
    along,
    combine,
    cross,
    dot,
    put_row,
    put_row_of,
    row,
    row_of,
    scaled,
    subtract,
    unit,
)
from services.mechanics.contact.frames import write_frame
from services.mechanics.contact.geometry import ContactGeometry, ToolGeometry
from services.mechanics.contact.hold_arrays import HoldArrays
from services.mechanics.contact.identity import pair_identity, with_law
from services.mechanics.contact.laws import number_of
from services.mechanics.contact.rows import ContactRows
from services.mechanics.contact.writer import NO_ROOM, add_tool_motion, append_row, put_on_curve, put_on_tool
from services.mechanics.rod.curve import point_on_curve

_SQUEEZE = number_of("squeeze")
# What has slipped less is where it was grasped, and stops the jaws there, see `squeeze`.
SLIPPED_M = 20e-6
# Cosine between the jaws and what is across the catheter in their plane below which it lies along them: no wedge.
LEAST_ACROSS = 0.3
# Sine of half the opening below which jaws are as good as parallel.
LEAST_SINE = 0.02
# As good as rigid: what gives way here is let in.
RIGID_SOFTNESS_M_N = 1e-9
# The springs of explicit contact, which know no rigid jaws.
PENALTY_SOFTNESS_M_N = 1e-2


@kernel
def append_wedges(rows: ContactRows, holds: HoldArrays, geometry: ContactGeometry, count: int) -> None:
    """Append a row for each of the first ``count`` holds in order whose catheter has slipped towards the hinge."""
    for index in range(count):
        slot = holds.order[index]
        is_held = geometry.tools.held[holds.tool[slot], CATHETER_SEGMENT]
        has_slipped = holds.anchor[slot, 2] < holds.grasped_m[slot] - SLIPPED_M
        if holds.target_kind[slot] == CATHETER_SEGMENT and is_held and has_slipped:
            _append_wedge(rows, holds, slot, geometry)


@inlined_kernel
def _append_wedge(rows: ContactRows, holds: HoldArrays, slot: int, geometry: ContactGeometry) -> None:
    tools, rod, tool = geometry.tools, geometry.rod, holds.tool[slot]
    first, weights, slope = point_on_curve(rod.position, holds.target[slot] + holds.weights[slot, 1])
    outward, lying = _outward(tools, tool, slope)
    sine, cosine = _half_opening(tools, tool)
    if lying < LEAST_ACROSS or sine < LEAST_SINE:
        return
    held = combine(weights, row(rod.position, first), row(rod.position, first + 1), row(rod.position, first + 2))
    arm = subtract(held, row_of(tools.segments[tool], JAW_A, 0))
    place_m = dot(outward, arm) / lying
    if place_m <= 0.0:
        return
    # By how much both axes part for each metre that the catheter goes outwards across itself.
    parts, apart_m = 2.0 * sine / lying, 2.0 * sine * place_m
    holds.apart_m[slot] = min(holds.apart_m[slot], apart_m)
    gap_m = (apart_m - holds.apart_m[slot]) / parts
    new = append_row(rows, _SQUEEZE, with_law(pair_identity(tool, SHAFT, -1, CATHETER_SEGMENT, slot), _SQUEEZE))
    if new == NO_ROOM:
        return
    put_row(rows.point_m, new, arm)
    put_on_tool(rows, new, tools, tool, SHAFT)
    put_on_curve(rows, new, first, weights)
    put_row_of(rows.frame, new, 0, scaled(outward, -1.0))
    write_frame(rows.frame[new, 0], rows.frame[new])
    rows.taken_m[new], rows.softness_m_n[new, 0] = gap_m, RIGID_SOFTNESS_M_N
    for axis in range(3):
        rows.lever[new, axis, 3] = -outward[axis] * place_m * cosine / parts
        rows.slip_m[new, axis] = -outward[axis] * gap_m
        for k in range(3):
            rows.slip_m[new, axis] -= weights[k] * rod.motion[first + k, axis]
    rows.softness_m_n[new, 1] = rows.softness_m_n[new, 2] = PENALTY_SOFTNESS_M_N
    add_tool_motion(rows, new, tools)


@kernel
def _outward(tools: ToolGeometry, tool: int, slope: Vector) -> tuple[Vector, float]:
    """Return the direction across the catheter, in the plane between the jaws, that leads to their tips.

    And its cosine with the tool's axis; zero where the catheter leads from one jaw to the other.
    """
    tangent, opening, axis = unit(slope), row_of(tools.frame, tool, 0), row_of(tools.frame, tool, 2)
    outward = cross(unit(along(opening, tangent, -dot(opening, tangent))), tangent)
    lying = dot(outward, axis)
    if lying < 0.0:
        return scaled(outward, -1.0), -lying
    return outward, lying


@kernel
def _half_opening(tools: ToolGeometry, tool: int) -> tuple[float, float]:
    """Return sine and cosine of half the opening at the start of the step."""
    segments = tools.segments[tool]
    jaw = unit(subtract(row_of(segments, JAW_A, 1), row_of(segments, JAW_A, 0)))
    return dot(jaw, row_of(tools.frame, tool, 0)), dot(jaw, row_of(tools.frame, tool, 2))
