"""The part of a rod that is in its introducer: the particles between its points nearest to the ends of the axis.

It is found in every step from the positions alone. A free part of the rod is not mistaken for the part inside, even if
it crosses an end plane next to the introducer, folds back along it, or is pulled round its edge.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import Vector, dot
from trocar.services.mechanics.rod.model import RodModel
from trocar.services.mechanics.rod.supports import IntroducerSprings


class Passage(NamedTuple):
    """Particles ``first`` to ``last`` are between entry and exit; segments first - 1 and last pass through these.

    ``has_entry`` and ``has_exit`` tell whether these segments exist; they do not if an end of the rod is inside.
    """

    first: int
    last: int
    has_entry: bool
    has_exit: bool


@kernel
def axial_position(introducer: IntroducerSprings, x: FloatArray, i: int) -> float:
    """Return the distance (m) of particle i beyond the entry plane."""
    total = 0.0
    for c in range(3):
        total += (x[i, c] - introducer.entry[c]) * introducer.axis[c]
    return total


@kernel
def offset_from_axis(introducer: IntroducerSprings, x: FloatArray, i: int) -> Vector:
    """Return the vector from the axis to particle i."""
    along = axial_position(introducer, x, i)
    return (
        x[i, 0] - introducer.entry[0] - along * introducer.axis[0],
        x[i, 1] - introducer.entry[1] - along * introducer.axis[1],
        x[i, 2] - introducer.entry[2] - along * introducer.axis[2],
    )


@kernel
def end_point(introducer: IntroducerSprings, axial: float) -> Vector:
    """Return the point of the axis at an axial position."""
    return (
        introducer.entry[0] + axial * introducer.axis[0],
        introducer.entry[1] + axial * introducer.axis[1],
        introducer.entry[2] + axial * introducer.axis[2],
    )


@kernel
def closest_on_segment(x: FloatArray, i: int, p: Vector) -> tuple[float, Vector]:
    """Return the parameter (0 to 1) of the point of segment i nearest to p, and the vector from p to that point."""
    r = (x[i, 0] - p[0], x[i, 1] - p[1], x[i, 2] - p[2])
    e = (x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1], x[i + 1, 2] - x[i, 2])
    squared = dot(e, e)
    s = min(max(-dot(e, r) / squared, 0.0), 1.0) if squared > 0.0 else 0.0
    return s, (r[0] + s * e[0], r[1] + s * e[1], r[2] + s * e[2])


@kernel
def _closest_segment(x: FloatArray, count: int, p: Vector) -> tuple[int, float]:
    """Return the nearest to p of the first ``count`` segments, and the parameter of its nearest point."""
    nearest, best, at = np.inf, 0, 0.0
    for i in range(count):
        s, o = closest_on_segment(x, i, p)
        squared = dot(o, o)
        if squared < nearest:
            nearest, best, at = squared, i, s
    return best, at


@kernel
def find_passage(introducer: IntroducerSprings, x: FloatArray) -> Passage:
    """Return the part of the rod at ``x`` (n, 3) that is in the introducer.

    The springs keep the rod at both ends of the axis, so the rod passes there with its nearest points. The energy of
    the springs depends on the smallest distance, so it is continuous even if another part of the rod comes equally
    near. If the nearest point is an end of the rod inside the introducer, no segment passes there.
    """
    n = x.shape[0]
    length = introducer.length
    last, at = _closest_segment(x, n - 1, end_point(introducer, length))
    if last == 0 and at == 0.0 and axial_position(introducer, x, 0) > length:
        return Passage(0, 0, False, False)
    has_exit = not (last == n - 2 and at == 1.0 and axial_position(introducer, x, n - 1) < length)
    entry, at = _closest_segment(x, last + 1, end_point(introducer, 0.0))
    if entry == 0 and at == 0.0 and axial_position(introducer, x, 0) > 0.0:
        return Passage(0, last if has_exit else n - 1, False, has_exit)
    if entry == n - 2 and at == 1.0 and axial_position(introducer, x, n - 1) < 0.0:
        return Passage(n - 1, n - 1, False, False)
    return Passage(entry + 1, last if has_exit else n - 1, True, has_exit)


@kernel
def depth_root(model: RodModel, i: int, axial: float) -> tuple[float, float]:
    """Return the root of the fraction of the full stiffness that holds particle i there, and its derivative (1/m).

    Over a segment behind a plane the root is 2 t - t^2, with t from 0 to 1, so that the force of the spring and its
    stiffness are continuous there. If the fraction were proportional to t, the energy would have a kink at the plane: a
    particle that is pushed sideways would come to rest on it, and no Newton iteration would converge. The ends of the
    rod are held even slightly beyond the far plane, because a stop yields.
    """
    length = model.introducer.length
    ramp, depth, sign = min(model.rest_length[0], 0.5 * length), axial, 1.0
    if axial > 0.5 * length:
        depth, sign = length - axial, -1.0
    is_end = i == (0 if sign < 0.0 else model.mass.shape[0] - 1)
    if is_end or depth >= ramp:
        return 1.0, 0.0
    t = max(depth, 0.0) / ramp
    return t * (2.0 - t), sign * (2.0 - 2.0 * t) / ramp if depth > 0.0 else 0.0


@kernel
def stop_overlap(model: RodModel, x: FloatArray, passage: Passage) -> tuple[int, float]:
    """Return the particle that is beyond a stop, and its overlap (m), positive towards the exit; (0, 0.0) if none is.

    The first particle stops two segments (at most half the introducer) before the exit, and the point ``least_tip_m``
    before the tip stops at the exit: the force acts on the last particle before it, which stops as much earlier. So the
    rod cannot leave its introducer.
    """
    length = model.introducer.length
    if not passage.has_entry and passage.first == 0:
        over = axial_position(model.introducer, x, 0) - (length - min(2.0 * model.rest_length[0], 0.5 * length))
        if over > 0.0:
            return 0, over
    least, spacing = model.introducer.least_tip, model.rest_length[0]
    bead = max(model.tip - int(np.ceil(least / spacing)), 0)
    if passage.last >= bead:
        early = max((model.tip - bead) * spacing - least, 0.0)
        short = axial_position(model.introducer, x, bead) + early - length
        if short < 0.0:
            return bead, short
    return 0, 0.0
