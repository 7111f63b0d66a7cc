"""Normal force of the introducer's wall on a rod, to which its Coulomb friction is proportional.

In a bore without clearance, a wall that keeps a bent rod straight exerts a couple. Its moment follows from the loads
outside, its arm from the length over which the wall bears. In the rod's model the arm is the distance of the particles,
so the sum of the forces on particles depends on their positions, and grows without bound under refinement. But a rod
model does not resolve a few of its diameters. So each force is spread along the axis over the bearing length, by a
quadratic B-spline, and overlapping forces are added as vectors. A single force then counts fully at any position, and a
couple M counts as 2 M / a, with the arm a = 4/9 of the bearing length, at any resolution finer than that.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.vectors import Vector, along, dot
from trocar.services.mechanics.rod.introducer_forces import passing_point
from trocar.services.mechanics.rod.introducer_passage import (
    Passage,
    axial_position,
    depth_root,
    end_point,
    offset_from_axis,
)
from trocar.services.mechanics.rod.model import RodModel

_SAMPLES_PER_SPAN = 4
_SPANS = 3


@inlined_kernel
def introducer_normal_force(model: RodModel, x: FloatArray, passage: Passage) -> float:
    """Return the integral [N] along the axis of the normal force of the introducer's wall on the rod at ``x`` (n, 3).

    It is a sum of samples at points that are fixed while the rod slides. They divide the spans of the spline evenly, so
    the weights of a force in them add up to 1 exactly.
    """
    introducer = model.introducer
    span = introducer.bearing_length / _SPANS
    spacing = span / _SAMPLES_PER_SPAN
    at_entry, at_exit = _end_offset(model, x, passage, True), _end_offset(model, x, passage, False)
    reach = 0.5 * introducer.bearing_length
    beyond = math.ceil(reach / spacing)
    total, first = 0.0, passage.first
    for k in range(-math.ceil((introducer.length + reach) / spacing), beyond + 1):
        at = introducer.length + k * spacing
        o = along((0.0, 0.0, 0.0), at_entry, _spline(at / span))
        o = along(o, at_exit, _spline((at - introducer.length) / span))
        while first <= passage.last and axial_position(introducer, x, first) < at - reach:
            first += 1
        for i in range(first, passage.last + 1):
            axial = axial_position(introducer, x, i)
            if axial > at + reach:
                break
            share = depth_root(model, i, axial)[0] ** 2 * _spline((axial - at) / span)
            o = along(o, offset_from_axis(introducer, x, i), share)
        total += math.sqrt(dot(o, o))
    return float(introducer.stiffness * total / _SAMPLES_PER_SPAN)


@kernel
def _end_offset(model: RodModel, x: FloatArray, passage: Passage, is_entry: bool) -> Vector:
    """Return the offset (m) of the rod from an end of the axis; zero if it does not pass this end."""
    introducer = model.introducer
    if not (passage.has_entry if is_entry else passage.has_exit):
        return (0.0, 0.0, 0.0)
    segment, axial = (passage.first - 1, 0.0) if is_entry else (passage.last, introducer.length)
    return passing_point(x, segment, end_point(introducer, axial)).offset


@kernel
def _spline(s: float) -> float:
    """Return the quadratic B-spline of unit knots about 0, of area 1."""
    s = abs(s)
    if s < 0.5:
        return 0.75 - s * s
    return 0.5 * (1.5 - s) ** 2 if s < 1.5 else 0.0
