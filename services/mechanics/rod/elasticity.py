"""Stretch and bending of a chain of particles: energy, exact force, and a positive semidefinite tangent.

Stretch energy of a segment: ``EA/(2 l0) (l - l0)^2``. Bending energy of a joint: ``k/2 theta^2`` with theta the angle
between its two segments and ``k = EI/l0``: the bending spring of the paper's eq. 27, whose force per particle is
``k theta / l``. Uniform curvature is exact; other shapes converge to the elastica as l0^2. The force is the gradient of
this energy, so it sums to zero and has no moment, to rounding, in every configuration.

The tangent drops what is not positive: the geometric stiffness of a compressed segment and the terms of a joint that
only turn it. What is left is the Gauss-Newton matrix plus the positive geometric part, so the banded matrix is always
SPD; equilibria and buckling loads come from the force and are not changed.

``scale`` throughout is what the stiffness is multiplied with in the band: scale[0] where the material's damping acts
too (along a segment, in the plane of bending), scale[1] where only stiffness does; zero: no tangent is wanted.
"""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.vectors import Vector, cross, dot, row
from services.mechanics.rod.model import RodModel, RodWork

Scale = tuple[float, float]

_STRAIGHT = 1e-12  # sine of an angle below which the bending plane is taken as any plane
_NO_PLANE = 1e-6  # angle below which bending is damped alike in every plane: it has none yet
SHORTEST = 1e-2  # of the rest length: a segment crushed below it bends as if it were that long


@kernel
def any_normal(t: Vector) -> Vector:
    """A unit vector normal to the unit vector ``t``."""
    other = (1.0, 0.0, 0.0) if abs(t[0]) < 0.6 else (0.0, 1.0, 0.0)
    normal = cross(t, other)
    scale = 1.0 / math.sqrt(dot(normal, normal))
    return (normal[0] * scale, normal[1] * scale, normal[2] * scale)


@kernel
def segment_geometry(work: RodWork) -> None:
    """Fill unit tangents and lengths of the segments; coincident particles keep the last tangent."""
    x = work.position
    for j in range(work.length.shape[0]):
        e = (x[j + 1, 0] - x[j, 0], x[j + 1, 1] - x[j, 1], x[j + 1, 2] - x[j, 2])
        length = math.sqrt(dot(e, e))
        work.length[j] = length
        if length > 0.0:
            for c in range(3):
                work.tangent[j, c] = e[c] / length


@kernel
def bending_angle(t: Vector, u: Vector) -> tuple[float, Vector]:
    """Angle between unit vectors, and the unit binormal t x u (any normal of t where they are parallel)."""
    b = cross(t, u)
    sine = math.sqrt(dot(b, b))
    cosine = dot(t, u)
    if sine > _STRAIGHT:
        return math.atan2(sine, cosine), (b[0] / sine, b[1] / sine, b[2] / sine)
    return (0.0 if cosine > 0.0 else math.pi), any_normal(t)


@kernel
def geometric_bending(theta: float) -> float:
    """(theta/2) cot(theta/2): bending stiffness out of the plane of a bent joint relative to the one in its plane."""
    half = 0.5 * theta
    if half < 1e-4:
        return 1.0 - half * half / 3.0
    return max(half / math.tan(half), 0.0)


@kernel
def stretch_energy(model: RodModel, work: RodWork) -> float:
    """Stretch energy [J] at the geometry in ``work``."""
    total = 0.0
    for j in range(work.length.shape[0]):
        total += 0.5 * model.EA[j] / model.rest_length * (work.length[j] - model.rest_length) ** 2
    return total


@kernel
def bending_energy(model: RodModel, work: RodWork) -> float:
    """Bending energy [J] of the inner joints at the geometry in ``work``."""
    total = 0.0
    for i in range(model.joint_stiffness.shape[0]):
        theta, _ = bending_angle(row(work.tangent, i), row(work.tangent, i + 1))
        total += 0.5 * model.joint_stiffness[i] * theta * theta
    return total


@kernel
def add_stretch(model: RodModel, work: RodWork) -> None:
    """Add the stretch forces, with the material's damping on the rate of stretch."""
    v = work.velocity
    f = work.force
    for j in range(work.length.shape[0]):
        t = row(work.tangent, j)
        rate = dot(t, (v[j + 1, 0] - v[j, 0], v[j + 1, 1] - v[j, 1], v[j + 1, 2] - v[j, 2]))
        tension = model.EA[j] / model.rest_length * (work.length[j] - model.rest_length + model.beta * rate)
        for c in range(3):
            f[j, c] += tension * t[c]
            f[j + 1, c] -= tension * t[c]


@kernel
def add_stretch_tangent(model: RodModel, work: RodWork, scale: Scale) -> None:
    """Add the stretch stiffness: along each segment, and the geometric one of a segment in tension."""
    band = work.band
    for j in range(work.length.shape[0]):
        t = row(work.tangent, j)
        k = model.EA[j] / model.rest_length
        geometric = scale[1] * k * max(0.0, 1.0 - model.rest_length / max(work.length[j], model.rest_length))
        along = scale[0] * k - geometric
        first = 3 * j
        for c in range(3):
            for a in range(3):
                value = along * t[c] * t[a]
                if a == c:
                    value += geometric
                if a >= c:
                    band[first + c, a - c] += value
                    band[first + 3 + c, a - c] += value
                band[first + c, 3 + a - c] -= value


@kernel
def joint_gradient(t: Vector, u: Vector, lengths: tuple[float, float], b: Vector, gradient: FloatArray) -> None:
    """Fill gradient[0] with d theta / d x of the three particles, gradient[1] with the same for out-of-plane bending.

    An infinite length is a tangent that no particle turns: a wall.
    """
    p = cross(b, t)
    w = cross(b, u)
    before = 1.0 / lengths[0]
    after = 1.0 / lengths[1]
    for c in range(3):
        gradient[0, c] = p[c] * before
        gradient[0, 6 + c] = w[c] * after
        gradient[0, 3 + c] = -gradient[0, c] - gradient[0, 6 + c]
        gradient[1, c] = b[c] * before
        gradient[1, 6 + c] = b[c] * after
        gradient[1, 3 + c] = -gradient[1, c] - gradient[1, 6 + c]


@kernel
def joint_rate(gradient: FloatArray, v: FloatArray, first: int) -> float:
    """Rate of the strain of a joint whose three particles start at ``first``."""
    rate = 0.0
    for c in range(3):
        rate += gradient[c] * v[first, c] + gradient[3 + c] * v[first + 1, c] + gradient[6 + c] * v[first + 2, c]
    return rate


@kernel
def add_joint_force(gradient: FloatArray, moment: float, first: int, f: FloatArray) -> None:
    """Subtract moment times the gradient from the three particles from ``first`` on."""
    for c in range(3):
        f[first, c] -= moment * gradient[c]
        f[first + 1, c] -= moment * gradient[3 + c]
        f[first + 2, c] -= moment * gradient[6 + c]


@kernel
def add_rank_one(band: FloatArray, first: int, vector: FloatArray, factor: float) -> None:
    """Add factor * vector vector^T (9 consecutive unknowns from ``first``) to a banded matrix."""
    for c in range(9):
        value = factor * vector[c]
        for a in range(9 - c):
            band[first + c, a] += value * vector[c + a]


@kernel
def add_bending(model: RodModel, work: RodWork, scale: Scale) -> None:
    """Add the bending forces -k (theta + beta dtheta/dt) d theta/dx and their tangent."""
    shortest = SHORTEST * model.rest_length
    q = work.gradient[0]
    r = work.gradient[1]
    for i in range(model.joint_stiffness.shape[0]):
        t = row(work.tangent, i)
        u = row(work.tangent, i + 1)
        theta, b = bending_angle(t, u)
        joint_gradient(t, u, (max(work.length[i], shortest), max(work.length[i + 1], shortest)), b, work.gradient)
        k = model.joint_stiffness[i]
        add_joint_force(q, k * (theta + model.beta * joint_rate(q, work.velocity, i)), i, work.force)
        if theta < _NO_PLANE:
            add_joint_force(r, k * model.beta * joint_rate(r, work.velocity, i), i, work.force)
        if scale[0] > 0.0:
            out_of_plane = scale[0] if theta < _NO_PLANE else scale[1] * geometric_bending(theta)
            add_rank_one(work.band, 3 * i, q, scale[0] * k)
            add_rank_one(work.band, 3 * i, r, out_of_plane * k)
