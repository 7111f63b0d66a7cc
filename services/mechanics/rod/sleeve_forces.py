"""Forces of the sleeve that a rod slides through, with their positive semidefinite tangent.

Held to the axis are the points where the centreline passes the entry and exit planes, and every particle between them;
a particle's spring grows from nothing at a plane to its full stiffness one segment inside, so that sliding in or out
changes no force by a jump. All springs are the gradient of an energy: without friction the sleeve takes no work.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .elasticity import Scale, Vector, dot, row
from .model import RodModel, RodWork

FloatArray = NDArray[np.float64]


@njit(cache=True, nogil=True, fastmath=False)
def add_sleeve(model: RodModel, work: RodWork, scale: Scale) -> None:
    """Add the forces that keep the rod on the axis of the sleeve, and friction along it.

    scale is ((theta dt)^2, theta dt): what stiffness and damping are multiplied with in the band; (0, dt) is an
    explicit step, in which friction may stop the rod but not turn it round; (0, 0) is no step, only forces.
    """
    after = _axial(model.sleeve, work.position, 0)
    for i in range(work.position.shape[0]):
        here = after
        if 0.0 < here < model.sleeve[6]:
            _hold_particle(model, work, i, here, scale)
        if i + 1 < work.position.shape[0]:
            after = _axial(model.sleeve, work.position, i + 1)
            for plane in (0.0, model.sleeve[6]):
                if (here < plane) != (after < plane):
                    _hold_crossing(model, work, i, plane, scale)


@njit(cache=True, nogil=True, fastmath=False)
def sleeve_energy(model: RodModel, work: RodWork) -> float:
    """Energy [J] of the springs that hold the rod to the axis of the sleeve."""
    total = 0.0
    after = _axial(model.sleeve, work.position, 0)
    for i in range(work.position.shape[0]):
        here = after
        if 0.0 < here < model.sleeve[6]:
            o = _offset(model.sleeve, work.position, i, 0.0)
            total += _depth_weight(model, here)[0] * dot(o, o)
        if i + 1 < work.position.shape[0]:
            after = _axial(model.sleeve, work.position, i + 1)
            for plane in (0.0, model.sleeve[6]):
                if (here < plane) != (after < plane):
                    o = _offset(model.sleeve, work.position, i, (plane - here) / (after - here))
                    total += dot(o, o)
    return 0.5 * float(model.sleeve[7]) * total


@njit(cache=True, nogil=True, fastmath=False)
def _axial(sleeve: FloatArray, x: FloatArray, i: int) -> float:
    total = 0.0
    for c in range(3):
        total += (x[i, c] - sleeve[c]) * sleeve[3 + c]
    return total


@njit(cache=True, nogil=True, fastmath=False)
def _offset(sleeve: FloatArray, x: FloatArray, i: int, s: float) -> Vector:
    """From the axis to the point (1 - s) x_i + s x_{i+1}."""
    j = i + 1 if s > 0.0 else i
    p = (
        (1.0 - s) * x[i, 0] + s * x[j, 0] - sleeve[0],
        (1.0 - s) * x[i, 1] + s * x[j, 1] - sleeve[1],
        (1.0 - s) * x[i, 2] + s * x[j, 2] - sleeve[2],
    )
    along = p[0] * sleeve[3] + p[1] * sleeve[4] + p[2] * sleeve[5]
    return (p[0] - along * sleeve[3], p[1] - along * sleeve[4], p[2] - along * sleeve[5])


@njit(cache=True, nogil=True, fastmath=False)
def _depth_weight(model: RodModel, axial: float) -> tuple[float, float]:
    """Share of the full stiffness at an axial position inside the sleeve, and its derivative."""
    ramp = min(model.rest_length, 0.5 * model.sleeve[6])
    if axial < ramp:
        return axial / ramp, 1.0 / ramp
    if axial > model.sleeve[6] - ramp:
        return (model.sleeve[6] - axial) / ramp, -1.0 / ramp
    return 1.0, 0.0


@njit(cache=True, nogil=True, fastmath=False)
def _hold_particle(model: RodModel, work: RodWork, i: int, axial: float, scale: Scale) -> None:
    o = _offset(model.sleeve, work.position, i, 0.0)
    weight, slope = _depth_weight(model, axial)
    k = model.sleeve[7] * weight
    along = 0.5 * model.sleeve[7] * slope * dot(o, o)
    for c in range(3):
        work.force[i, c] -= k * o[c] + along * model.sleeve[3 + c]
    drag = _friction(model, work, (i, 0.0, 0.0), k, scale)
    if scale[0] > 0.0:
        _add_tangent(model, work, (i, 0.0), (0.0, 0.0, 0.0), (scale[0] * k, scale[1] * drag))


@njit(cache=True, nogil=True, fastmath=False)
def _crossing(sleeve: FloatArray, x: FloatArray, i: int, plane: float) -> float:
    """Where along segment i (0 to 1) it passes an end plane; the nearer end of a segment that does not."""
    here = _axial(sleeve, x, i)
    after = _axial(sleeve, x, i + 1)
    if after == here:
        return 0.0
    return float(min(max((plane - here) / (after - here), 0.0), 1.0))


@njit(cache=True, nogil=True, fastmath=False)
def _hold_crossing(model: RodModel, work: RodWork, i: int, plane: float, scale: Scale) -> None:
    """Hold the point of segment i that lies in an end plane; as the segment tilts, the push is normal to the rod."""
    s = _crossing(model.sleeve, work.position, i, plane)
    t = row(work.tangent, i)
    a = (model.sleeve[3], model.sleeve[4], model.sleeve[5])
    cosine = dot(a, t)
    tilt = (t[0] / cosine - a[0], t[1] / cosine - a[1], t[2] / cosine - a[2])
    o = _offset(model.sleeve, work.position, i, s)
    k = model.sleeve[7]
    along = dot(tilt, o)
    for c in range(3):
        push = k * (o[c] - along * a[c])
        work.force[i, c] -= (1.0 - s) * push
        work.force[i + 1, c] -= s * push
    drag = _friction(model, work, (i, s, _crossing(model.sleeve, work.settled, i, plane)), k, scale)
    if scale[0] > 0.0:
        _add_tangent(model, work, (i, s), tilt, (scale[0] * k, scale[1] * drag))


@njit(cache=True, nogil=True, fastmath=False)
def _friction(model: RodModel, work: RodWork, at: tuple[int, float, float], k: float, scale: Scale) -> float:
    """Brake the point by Coulomb friction along the axis, viscous below the slip speed; return force per speed.

    The wall's push is the one that the last step solved for: at the prediction that forces are taken at, the stiff
    springs stand under loads that never come about. `at` is (particle, share of the segment behind it that the point
    lies at now, and did then).
    """
    i, s, settled = at
    if model.sleeve[8] == 0.0:
        return 0.0
    j = i + 1 if s > 0.0 else i
    speed = 0.0
    for c in range(3):
        speed += ((1.0 - s) * work.velocity[i, c] + s * work.velocity[j, c]) * model.sleeve[3 + c]
    o = _offset(model.sleeve, work.settled, i, settled)
    drag = model.sleeve[8] * k * math.sqrt(dot(o, o)) / max(abs(speed), model.sleeve[9])
    if scale[0] == 0.0 and scale[1] > 0.0:
        drag = min(drag, 0.25 * model.mass[i] / scale[1])
    for c in range(3):
        work.force[i, c] -= (1.0 - s) * drag * speed * model.sleeve[3 + c]
        work.force[j, c] -= s * drag * speed * model.sleeve[3 + c]
    return float(drag)


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
