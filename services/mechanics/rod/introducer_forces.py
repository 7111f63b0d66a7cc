"""Forces of the introducer through which a rod slides, with their positive semidefinite tangent.

Springs pull the points of the rod's curve that are nearest to the ends of the axis to these ends, and every particle
between them to the axis. The stiffness of a particle's spring grows smoothly from zero at an end plane to its full
value one segment inside, so that forces and stiffnesses stay continuous when the rod slides. Stops keep both ends of
the rod from leaving; a step that runs into a stop is taken by implicit Euler, because a stop that acts half a step late
would add energy. All forces are the gradient of an energy, so they dissipate nothing; friction is solved with the
contacts.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.vectors import Vector, along, dot, scaled
from trocar.services.mechanics.rod.curve import CurvePoint, closest_on_curve
from trocar.services.mechanics.rod.introducer_passage import (
    axial_position,
    closest_on_segment,
    depth_root,
    end_point,
    find_passage,
    offset_from_axis,
    stop_overlap,
)
from trocar.services.mechanics.rod.model import RodModel, RodWork


@inlined_kernel
def add_introducer(model: RodModel, work: RodWork, scale: float) -> None:
    """Add the forces that keep the rod on the axis and inside the introducer.

    ``scale`` is the factor of the stiffness in the band; if it is 0, only forces are added.
    """
    passage = find_passage(model.introducer, work.position)
    for i in range(passage.first, passage.last + 1):
        _hold_particle(model, work, i, axial_position(model.introducer, work.position, i), scale)
    if passage.has_entry:
        _hold_end(model, work, passage.first - 1, 0.0, scale)
    if passage.has_exit:
        _hold_end(model, work, passage.last, model.introducer.length, scale)
    i, over = stop_overlap(model, work.end_position if work.is_middle else work.position, passage)
    if work.is_middle:
        work.hits_stop = over != 0.0
    elif over != 0.0:
        _stop(model, work, i, over, scale)


@kernel
def introducer_energy(model: RodModel, x: FloatArray) -> float:
    """Return the energy [J] of the introducer's springs and stops for a rod at ``x`` (n, 3)."""
    passage = find_passage(model.introducer, x)
    total = 0.0
    for i in range(passage.first, passage.last + 1):
        o = offset_from_axis(model.introducer, x, i)
        total += depth_root(model, i, axial_position(model.introducer, x, i))[0] ** 2 * dot(o, o)
    if passage.has_entry:
        o = passing_point(x, passage.first - 1, end_point(model.introducer, 0.0)).offset
        total += dot(o, o)
    if passage.has_exit:
        o = passing_point(x, passage.last, end_point(model.introducer, model.introducer.length)).offset
        total += dot(o, o)
    over = stop_overlap(model, x, passage)[1]
    return 0.5 * float(model.introducer.stiffness * total + model.introducer.stop_stiffness * over * over)


@kernel
def introducer_excess(model: RodModel, work: RodWork, x: FloatArray, scale: float) -> float:
    """Return the springs' energy [J] after ``x`` moves by ``scale`` times the solution, minus its quadratic model.

    The quadratic model is that of the forces and the matrix: the same particles are held, across the same directions.
    It fails where the rod is sharply bent at an end of the axis: without this check steps may oscillate there.
    """
    moved = work.end_position
    for i in range(x.shape[0]):
        for c in range(3):
            moved[i, c] = x[i, c] + scale * work.rhs[3 * i + c]
    return introducer_energy(model, moved) - introducer_energy(model, x) - _quadratic_change(model, work, x, scale)


@inlined_kernel
def _quadratic_change(model: RodModel, work: RodWork, x: FloatArray, scale: float) -> float:
    introducer = model.introducer
    axis = (introducer.axis[0], introducer.axis[1], introducer.axis[2])
    passage, total = find_passage(introducer, x), 0.0
    for i in range(passage.first, passage.last + 1):
        o = offset_from_axis(introducer, x, i)
        root, slope = depth_root(model, i, axial_position(introducer, x, i))
        d = _moved(work, i, scale)
        inwards = slope * dot(d, axis)
        total += root * root * _across(o, d, axis) + inwards * (root + 0.5 * inwards) * dot(o, o)
        total += root * inwards * dot(o, d)
    for is_there, i, axial in (
        (passage.has_entry, passage.first - 1, 0.0),
        (passage.has_exit, passage.last, introducer.length),
    ):
        if is_there:
            point = passing_point(x, i, end_point(introducer, axial))
            total += _across(point.offset, _moved_point(work, point, scale), point.direction)
    i, over = stop_overlap(model, x, passage)
    way = dot(_moved(work, i, scale), axis) if over != 0.0 else 0.0
    return float(introducer.stiffness * total + introducer.stop_stiffness * (over + 0.5 * way) * way)


@kernel
def _across(o: Vector, d: Vector, direction: Vector) -> float:
    """Return the change of |o|^2 / 2 by a motion d, with the second-order term of d normal to a direction only."""
    parallel = dot(d, direction)
    return dot(o, d) + 0.5 * (dot(d, d) - parallel * parallel)


@kernel
def _moved(work: RodWork, i: int, scale: float) -> Vector:
    """Return the motion of particle i by ``scale`` times the solution."""
    return (scale * work.rhs[3 * i], scale * work.rhs[3 * i + 1], scale * work.rhs[3 * i + 2])


@inlined_kernel
def _moved_point(work: RodWork, point: CurvePoint, scale: float) -> Vector:
    """Return the motion of a point of the curve by ``scale`` times the solution."""
    total = scaled(_moved(work, point.first, scale), point.weights[0])
    total = along(total, _moved(work, point.first + 1, scale), point.weights[1])
    return along(total, _moved(work, point.first + 2, scale), point.weights[2])


@inlined_kernel
def _stop(model: RodModel, work: RodWork, i: int, over: float, scale: float) -> None:
    k = model.introducer.stop_stiffness
    for c in range(3):
        work.force[i, c] -= k * over * model.introducer.axis[c]
        if scale > 0.0:
            for b in range(c, 3):
                work.band[3 * i + c, b - c] += scale * k * model.introducer.axis[c] * model.introducer.axis[b]


@inlined_kernel
def _hold_particle(model: RodModel, work: RodWork, i: int, axial: float, scale: float) -> None:
    a = (model.introducer.axis[0], model.introducer.axis[1], model.introducer.axis[2])
    o = offset_from_axis(model.introducer, work.position, i)
    root, slope = depth_root(model, i, axial)
    stiffness = model.introducer.stiffness
    k, inwards = stiffness * root * root, stiffness * root * slope * dot(o, o)
    for c in range(3):
        work.force[i, c] -= k * o[c] + inwards * a[c]
    if scale > 0.0:
        _add_tangent(work, (i, 1), (1.0, 0.0, 0.0), a, scale * k)
        for c in range(3):
            for b in range(c + 1):
                crossed = root * (o[c] * a[b] + a[c] * o[b]) + slope * dot(o, o) * a[c] * a[b]
                work.band[3 * i + b, c - b] += scale * stiffness * slope * crossed


@kernel
def _hold_end(model: RodModel, work: RodWork, i: int, axial: float, scale: float) -> None:
    """Pull the curve's point nearest to an end of the axis to this end, normal to the rod; segment i is nearest."""
    point = passing_point(work.position, i, end_point(model.introducer, axial))
    k = model.introducer.stiffness
    for particle in range(3):
        for c in range(3):
            work.force[point.first + particle, c] -= point.weights[particle] * k * point.offset[c]
    if scale > 0.0:
        _add_tangent(work, (point.first, 3), point.weights, point.direction, scale * k)


@kernel
def passing_point(x: FloatArray, i: int, end: Vector) -> CurvePoint:
    """Return the curve's point nearest to an end of the axis; segment i is the nearest one of the polygon."""
    return closest_on_curve(x, i, closest_on_segment(x, i, end)[0], end)


@kernel
def _add_tangent(work: RodWork, particles: tuple[int, int], weights: Vector, direction: Vector, lateral: float) -> None:
    """Add the Gauss-Newton stiffness of a point held across a direction; ``particles`` are (first, how many)."""
    first, count = particles
    for c in range(3):
        for b in range(3):
            value = lateral * ((1.0 if b == c else 0.0) - direction[c] * direction[b])
            for i in range(count):
                for j in range(i, count):
                    if j > i or b >= c:
                        work.band[3 * (first + i) + c, 3 * (j - i) + b - c] += weights[i] * weights[j] * value
