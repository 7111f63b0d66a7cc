"""Forces of the sleeve that a rod slides through, with their positive semidefinite tangent.

Held to the axis are the points where the centreline passes the entry and exit planes, and every particle between them;
a particle's spring grows from nothing at a plane to its full stiffness one segment inside, so that sliding in or out
changes no force by a jump. Stops keep both ends of the rod from leaving. All springs are the gradient of an energy:
without friction the sleeve takes no work.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .elasticity import Scale, Vector, dot, row
from .model import RodModel, RodWork
from .sleeve_passage import (
    FRICTION,
    LENGTH,
    SEAL,
    SLIP_SPEED,
    STIFFNESS,
    STOP_STIFFNESS,
    axial_position,
    crossing,
    depth_weight,
    find_passage,
    offset_from_axis,
    stop_overlap,
)

FloatArray = NDArray[np.float64]


@njit(cache=True, nogil=True, fastmath=False)
def add_sleeve(model: RodModel, work: RodWork, scale: Scale) -> None:
    """Add the forces that keep the rod on the axis of the sleeve and in it, and friction along it.

    scale is ((theta dt)^2, theta dt): what stiffness and damping are multiplied with in the band; (0, dt) is an
    explicit step, in which friction may stop the rod but not turn it round; (0, 0) is no step, only forces.
    """
    passage = find_passage(model.sleeve, work.position)
    for i in range(passage.first, passage.last + 1):
        _hold_particle(model, work, i, axial_position(model.sleeve, work.position, i), scale)
    if passage.has_entry:
        _hold_crossing(model, work, passage.first - 1, 0.0, scale)
    if passage.has_exit:
        _hold_crossing(model, work, passage.last, model.sleeve[LENGTH], scale)
    i, over = stop_overlap(model, work.position, passage)
    if over != 0.0:
        _stop(model, work, i, over, scale)


@njit(cache=True, nogil=True, fastmath=False)
def sleeve_energy(model: RodModel, work: RodWork) -> float:
    """Energy [J] of the springs that hold the rod to the axis of the sleeve, and of its stops."""
    x = work.position
    passage = find_passage(model.sleeve, x)
    total = 0.0
    for i in range(passage.first, passage.last + 1):
        o = offset_from_axis(model.sleeve, x, i, 0.0)
        total += depth_weight(model, i, axial_position(model.sleeve, x, i))[0] * dot(o, o)
    if passage.has_entry:
        i = passage.first - 1
        o = offset_from_axis(model.sleeve, x, i, crossing(model.sleeve, x, i, 0.0))
        total += dot(o, o)
    if passage.has_exit:
        i = passage.last
        o = offset_from_axis(model.sleeve, x, i, crossing(model.sleeve, x, i, model.sleeve[LENGTH]))
        total += dot(o, o)
    over = stop_overlap(model, x, passage)[1]
    return 0.5 * float(model.sleeve[STIFFNESS] * total + model.sleeve[STOP_STIFFNESS] * over * over)


@njit(cache=True, nogil=True, fastmath=False)
def _stop(model: RodModel, work: RodWork, i: int, over: float, scale: Scale) -> None:
    k = model.sleeve[STOP_STIFFNESS]
    for c in range(3):
        work.force[i, c] -= k * over * model.sleeve[3 + c]
        if scale[0] > 0.0:
            for b in range(c, 3):
                work.band[3 * i + c, b - c] += scale[0] * k * model.sleeve[3 + c] * model.sleeve[3 + b]


@njit(cache=True, nogil=True, fastmath=False)
def _hold_particle(model: RodModel, work: RodWork, i: int, axial: float, scale: Scale) -> None:
    o = offset_from_axis(model.sleeve, work.position, i, 0.0)
    weight, slope = depth_weight(model, i, axial)
    k = model.sleeve[STIFFNESS] * weight
    along = 0.5 * model.sleeve[STIFFNESS] * slope * dot(o, o)
    for c in range(3):
        work.force[i, c] -= k * o[c] + along * model.sleeve[3 + c]
    drag = _friction(model, work, (i, 0.0, 0.0), (k, 0.0), scale)
    if scale[0] > 0.0:
        _add_tangent(model, work, (i, 0.0), (0.0, 0.0, 0.0), (scale[0] * k, scale[1] * drag))


@njit(cache=True, nogil=True, fastmath=False)
def _hold_crossing(model: RodModel, work: RodWork, i: int, plane: float, scale: Scale) -> None:
    """Hold the point of segment i that lies in an end plane; as the segment tilts, the push is normal to the rod."""
    s = crossing(model.sleeve, work.position, i, plane)
    t = row(work.tangent, i)
    a = (model.sleeve[3], model.sleeve[4], model.sleeve[5])
    cosine = dot(a, t)
    tilt = (t[0] / cosine - a[0], t[1] / cosine - a[1], t[2] / cosine - a[2])
    o = offset_from_axis(model.sleeve, work.position, i, s)
    k = model.sleeve[STIFFNESS]
    along = dot(tilt, o)
    for c in range(3):
        push = k * (o[c] - along * a[c])
        work.force[i, c] -= (1.0 - s) * push
        work.force[i + 1, c] -= s * push
    seal = model.sleeve[SEAL] if plane > 0.0 else 0.0
    drag = _friction(model, work, (i, s, crossing(model.sleeve, work.settled, i, plane)), (k, seal), scale)
    if scale[0] > 0.0:
        _add_tangent(model, work, (i, s), tilt, (scale[0] * k, scale[1] * drag))


@njit(cache=True, nogil=True, fastmath=False)
def _friction(
    model: RodModel, work: RodWork, at: tuple[int, float, float], wall: tuple[float, float], scale: Scale
) -> float:
    """Brake the point by Coulomb friction along the axis, viscous below the slip speed; return force per speed.

    The wall's push and the speed that sets the slope are those that the last step ended with: at the prediction that
    forces are taken at, the stiff springs stand under loads that never come about, and a rod under tension does not
    move at all. `at` is (particle, share of the segment behind it that the point lies at now, and did then); `wall`
    is (stiffness, friction of the seal).
    """
    i, s, settled = at
    k, seal = wall
    if model.sleeve[FRICTION] == 0.0 and seal == 0.0:
        return 0.0
    j = i + 1 if s > 0.0 else i
    speed = _axial_speed(model, work.velocity, i, s)
    before = abs(_axial_speed(model, work.settled_velocity, i, s))
    o = offset_from_axis(model.sleeve, work.settled, i, settled)
    most = model.sleeve[FRICTION] * k * math.sqrt(dot(o, o)) + seal
    drag = most / max(before, model.sleeve[SLIP_SPEED])
    if scale[0] == 0.0 and scale[1] > 0.0:
        drag = min(drag, 0.25 * model.mass[i] / scale[1])
    for c in range(3):
        work.force[i, c] -= (1.0 - s) * drag * speed * model.sleeve[3 + c]
        work.force[j, c] -= s * drag * speed * model.sleeve[3 + c]
    return float(drag)


@njit(cache=True, nogil=True, fastmath=False)
def _axial_speed(model: RodModel, v: FloatArray, i: int, s: float) -> float:
    """Speed along the axis of the point (1 - s) x_i + s x_{i+1}."""
    j = i + 1 if s > 0.0 else i
    speed = 0.0
    for c in range(3):
        speed += ((1.0 - s) * v[i, c] + s * v[j, c]) * model.sleeve[3 + c]
    return speed


@njit(cache=True, nogil=True, fastmath=False)
def _add_tangent(
    model: RodModel, work: RodWork, at: tuple[int, float], tilt: Vector, factor: tuple[float, float]
) -> None:
    """Gauss-Newton stiffness of the held point and the drag along the axis, between its two particles."""
    i, s = at
    lateral, drag = factor
    a = (model.sleeve[3], model.sleeve[4], model.sleeve[5])
    along = lateral * (dot(tilt, tilt) - 1.0) + drag
    for c in range(3):
        for b in range(3):
            value = along * a[c] * a[b] - lateral * (a[c] * tilt[b] + tilt[c] * a[b])
            if b == c:
                value += lateral
            if b >= c:
                work.band[3 * i + c, b - c] += (1.0 - s) * (1.0 - s) * value
            if s > 0.0:
                work.band[3 * i + c, 3 + b - c] += (1.0 - s) * s * value
                if b >= c:
                    work.band[3 * i + 3 + c, b - c] += s * s * value
