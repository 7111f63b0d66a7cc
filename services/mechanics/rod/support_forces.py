"""Forces of clamped ends and of the sleeve, with their positive semidefinite tangents."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .elasticity import Scale, bending_angle, geometric_bending, joint_gradient, row
from .model import RodModel, RodWork

FloatArray = NDArray[np.float64]


@njit(cache=True, nogil=True, fastmath=False)
def add_wall_joints(model: RodModel, work: RodWork, scale: Scale) -> None:
    """Add the half joints between the walls' directions and the end segments, stiffness 2 EI/l0 each.

    The same bending spring as inside the rod, with one of its two tangents fixed in space.
    """
    last = work.length.shape[0] - 1
    if not math.isnan(model.walls[0, 0]):
        wall = row(model.walls, 0)
        segment = row(work.tangent, 0)
        theta, b = bending_angle(wall, segment)
        joint_gradient(wall, segment, (math.inf, work.length[0]), b, work.gradient)
        _apply_wall(model, work, theta, (0, 3), scale)
    if not math.isnan(model.walls[1, 0]):
        wall = row(model.walls, 1)
        segment = row(work.tangent, last)
        theta, b = bending_angle(segment, wall)
        joint_gradient(segment, wall, (work.length[last], math.inf), b, work.gradient)
        _apply_wall(model, work, theta, (last, 0), scale)


@njit(cache=True, nogil=True, fastmath=False)
def _apply_wall(model: RodModel, work: RodWork, theta: float, where: tuple[int, int], scale: Scale) -> None:
    """The gradient has three particles; `where` is (first real particle, where it starts in the gradient)."""
    first, shift = where
    gradient = work.gradient
    k = model.wall_stiffness[0 if shift else 1]
    rate = 0.0
    for a in range(6):
        rate += gradient[0, shift + a] * work.velocity[first + a // 3, a % 3]
    for a in range(6):
        work.force[first + a // 3, a % 3] -= k * (theta + model.beta * rate) * gradient[0, shift + a]
    if scale[0] > 0.0:
        for kind, factor in ((0, scale[0] * k), (1, scale[1] * k * geometric_bending(theta))):
            for c in range(6):
                for a in range(6 - c):
                    work.band[3 * first + c, a] += factor * gradient[kind, shift + c] * gradient[kind, shift + c + a]


@njit(cache=True, nogil=True, fastmath=False)
def add_sleeve(model: RodModel, work: RodWork, scale: Scale) -> None:
    """Add the forces that keep the rod on the axis of the sleeve, and friction along it.

    scale is ((theta dt)^2, theta dt): what stiffness and damping are multiplied with in the band.
    """
    x = work.position
    before = _axial(model.sleeve, x, 0)
    for i in range(x.shape[0]):
        here = before
        if 0.0 <= here <= model.sleeve[6]:
            _hold(model.sleeve, model.mass[i], work, (i, 0.0), scale)
        if i + 1 < x.shape[0]:
            before = _axial(model.sleeve, x, i + 1)
            for plane in (0.0, model.sleeve[6]):
                if (here < plane) != (before < plane):
                    _hold(model.sleeve, model.mass[i], work, (i, (plane - here) / (before - here)), scale)


@njit(cache=True, nogil=True, fastmath=False)
def sleeve_energy(model: RodModel, work: RodWork) -> float:
    """Energy [J] of the lateral springs that hold the rod to the axis of the sleeve."""
    x = work.position
    length = model.sleeve[6]
    total = 0.0
    for i in range(x.shape[0]):
        here = _axial(model.sleeve, x, i)
        if 0.0 <= here <= length:
            total += _offset_squared(model.sleeve, x, i, 0.0)
        if i + 1 < x.shape[0]:
            after = _axial(model.sleeve, x, i + 1)
            for plane in (0.0, length):
                if (here < plane) != (after < plane):
                    total += _offset_squared(model.sleeve, x, i, (plane - here) / (after - here))
    return 0.5 * float(model.sleeve[7]) * total


@njit(cache=True, nogil=True, fastmath=False)
def _offset_squared(sleeve: FloatArray, x: FloatArray, i: int, s: float) -> float:
    j = i + 1 if s > 0.0 else i
    squared = 0.0
    along = 0.0
    for c in range(3):
        offset = (1.0 - s) * x[i, c] + s * x[j, c] - sleeve[c]
        squared += offset * offset
        along += offset * sleeve[3 + c]
    return max(squared - along * along, 0.0)


@njit(cache=True, nogil=True, fastmath=False)
def _axial(sleeve: FloatArray, x: FloatArray, i: int) -> float:
    total = 0.0
    for c in range(3):
        total += (x[i, c] - sleeve[c]) * sleeve[3 + c]
    return total


@njit(cache=True, nogil=True, fastmath=False)
def _hold(sleeve: FloatArray, mass: float, work: RodWork, at: tuple[int, float], scale: Scale) -> None:
    """Pull the point (1 - s) x_i + s x_{i+1} to the axis, and brake it along the axis by the friction of that pull."""
    i, s = at
    x = work.position
    v = work.velocity
    j = i + 1 if s > 0.0 else i
    k = sleeve[7]
    along = 0.0
    speed = 0.0
    for c in range(3):
        along += ((1.0 - s) * x[i, c] + s * x[j, c] - sleeve[c]) * sleeve[3 + c]
        speed += ((1.0 - s) * v[i, c] + s * v[j, c]) * sleeve[3 + c]
    push = 0.0
    for c in range(3):
        pull = k * ((1.0 - s) * x[i, c] + s * x[j, c] - sleeve[c] - along * sleeve[3 + c])
        push += pull * pull
        work.force[i, c] -= (1.0 - s) * pull
        work.force[j, c] -= s * pull
    drag = sleeve[8] * math.sqrt(push) / max(abs(speed), sleeve[9])
    if scale[0] == 0.0:  # an explicit step: friction may stop the rod within it but not turn it round
        drag = min(drag, mass / scale[1])
    for c in range(3):
        work.force[i, c] -= (1.0 - s) * drag * speed * sleeve[3 + c]
        work.force[j, c] -= s * drag * speed * sleeve[3 + c]
    if scale[0] > 0.0:
        _add_hold_tangent(sleeve, (i, s), (scale[0] * k, scale[1] * drag), work.band)


@njit(cache=True, nogil=True, fastmath=False)
def _add_hold_tangent(
    sleeve: FloatArray, at: tuple[int, float], factor: tuple[float, float], band: FloatArray
) -> None:
    i, s = at
    lateral, drag = factor
    for c in range(3):
        for a in range(3):
            value = (drag - lateral) * sleeve[3 + c] * sleeve[3 + a]
            if a == c:
                value += lateral
            if a >= c:
                band[3 * i + c, a - c] += (1.0 - s) * (1.0 - s) * value
            if s > 0.0:
                band[3 * i + c, 3 + a - c] += (1.0 - s) * s * value
                if a >= c:
                    band[3 * i + 3 + c, a - c] += s * s * value
