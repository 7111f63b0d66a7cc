"""Stretch and bending of a chain of particles: energy, exact force, and a positive semidefinite tangent.

Stretch energy of a segment: ``EA/(2 l0) (l - l0)^2``. Bending energy of a joint: ``k/2 theta^2`` with theta the angle
between its two segments and ``k = EI/l0``: the bending spring of the paper's eq. 27, whose force per particle is
``k theta / l``. Uniform curvature is exact; other shapes converge to the elastica as l0^2. The force is the gradient of
this energy, so it sums to zero and has no moment, to rounding, in every configuration.

The tangent drops what is not positive: the geometric stiffness of a compressed segment and the terms of a joint that
only turn it. What is left is the Gauss-Newton matrix plus the positive geometric part, so the banded matrix is always
SPD; equilibria and buckling loads come from the force and are not changed.

Damping acts on strains as if the particles were displaced by ``lead`` more. The material's lead is beta times their
velocities, and acts along a segment and on the angle of a joint; that of an implicit step, its numerical damping, acts
wherever there is stiffness. ``lead[0]`` is the sum of both, ``lead[1]`` the step's alone.

Only a material frame tells whether a joint whose plane turns bends its material, or rolls with it. A rod that has one
is also damped by c = (theta/2) cot(theta/2) r.v - theta s, the rate of its curvature in the material out of the plane,
with r the gradient there and s the rate at which directors turn. Forces and moments on directors are the derivatives of
beta k c^2/2 by v and s (`twist` has those with s), so a rigid rotation is not damped.

``scale`` is the factor of the stiffness in the band: scale[0] where the material's damping acts too (along a segment,
in the plane of bending), scale[1] where only stiffness acts; with zero no tangent is added.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.vectors import Vector, cross, dot, row, scaled
from trocar.services.mechanics.rod.model import RodModel, RodWork

Scale = tuple[float, float]

_STRAIGHT = 1e-12  # sine of an angle below which the bending plane is taken as any plane
_NO_PLANE = 1e-6  # angle below which bending has no plane, and is damped alike in every plane
SHORTEST = 1e-2  # of the rest length: a segment crushed below it bends as if it were that long


@kernel
def any_normal(t: Vector) -> Vector:
    """Return a unit vector normal to the unit vector ``t``."""
    other = (1.0, 0.0, 0.0) if abs(t[0]) < 0.6 else (0.0, 1.0, 0.0)
    normal = cross(t, other)
    scale = 1.0 / math.sqrt(dot(normal, normal))
    return (normal[0] * scale, normal[1] * scale, normal[2] * scale)


@kernel
def segment_geometry(model: RodModel, work: RodWork) -> None:
    """Fill unit tangents, lengths and elongations of the segments; coincident particles keep the last tangent."""
    x = work.position
    for j in range(work.length.shape[0]):
        e = (x[j + 1, 0] - x[j, 0], x[j + 1, 1] - x[j, 1], x[j + 1, 2] - x[j, 2])
        length = math.sqrt(dot(e, e))
        work.length[j] = length
        work.elongation[j] = length - model.rest_length[j]
        work.taut[j] = length - model.rest_length[j]
        work.chord[j] = 1.0
        if length > 0.0:
            for c in range(3):
                work.tangent[j, c] = e[c] / length


@inlined_kernel
def mean_elongation(model: RodModel, work: RodWork) -> None:
    """Replace elongations in the middle of a step by the mean of those at its ends, where rotation is no stretch.

    With the direction of the segment in the middle and ``chord``, its length there over the mean of the lengths, the
    work of the stretch force is exactly the change of the stretch energy (the discrete derivative of Simo and Tarnow
    1992, and Gonzalez 1996).
    """
    x = work.previous_position
    for j in range(work.length.shape[0]):
        before, after = 0.0, 0.0
        for c in range(3):
            start = x[j + 1, c] - x[j, c]
            end = 2.0 * work.length[j] * work.tangent[j, c] - start
            before += start * start
            after += end * end
        mean = 0.5 * (math.sqrt(before) + math.sqrt(after))
        work.elongation[j] = mean - model.rest_length[j]
        work.taut[j] = math.sqrt(before) - model.rest_length[j]
        work.chord[j] = work.length[j] / mean if mean > 0.0 else 1.0


@kernel
def bending_angle(t: Vector, u: Vector) -> tuple[float, Vector]:
    """Return the angle between unit vectors, and the unit binormal t x u (any normal of t if they are parallel)."""
    b = cross(t, u)
    sine = math.sqrt(dot(b, b))
    cosine = dot(t, u)
    if sine > _STRAIGHT:
        return math.atan2(sine, cosine), (b[0] / sine, b[1] / sine, b[2] / sine)
    return (0.0 if cosine > 0.0 else math.pi), any_normal(t)


@kernel
def geometric_bending(theta: float) -> float:
    """Return (theta/2) cot(theta/2), the bending stiffness of a bent joint out of its plane over that in its plane."""
    half = 0.5 * theta
    if half < 1e-4:
        return 1.0 - half * half / 3.0
    return max(half / math.tan(half), 0.0)


@kernel
def stretch_energy(model: RodModel, work: RodWork) -> float:
    """Return the stretch energy [J] at the geometry in ``work``."""
    total = 0.0
    for j in range(work.length.shape[0]):
        total += 0.5 * model.EA[j] / model.rest_length[j] * (work.length[j] - model.rest_length[j]) ** 2
    return total


@kernel
def bending_energy(model: RodModel, work: RodWork) -> float:
    """Return the bending energy [J] of the inner joints at the geometry in ``work``."""
    total = 0.0
    for i in range(model.joint_stiffness.shape[0]):
        theta, _ = bending_angle(row(work.tangent, i), row(work.tangent, i + 1))
        total += 0.5 * model.joint_stiffness[i] * theta * theta
    return total


@inlined_kernel
def add_stretch(model: RodModel, work: RodWork) -> None:
    """Add the stretch forces, damping included."""
    f = work.force
    for j in range(work.length.shape[0]):
        t = row(work.tangent, j)
        k = model.EA[j] / model.rest_length[j]
        lead, aside = _lead(work, j)
        along = work.chord[j] * k * (work.elongation[j] + dot(t, lead) - model.beta * model.growth[j])
        across = geometric_stretch(model, work, j)
        along -= across * dot(t, aside)
        for c in range(3):
            pull = along * t[c] + across * aside[c]
            f[j, c] += pull
            f[j + 1, c] -= pull


@inlined_kernel
def _lead(work: RodWork, j: int) -> tuple[Vector, Vector]:
    """Return how much both leads move the ends of segment j apart."""
    u, v = work.lead[0], work.lead[1]
    return (
        (u[j + 1, 0] - u[j, 0], u[j + 1, 1] - u[j, 1], u[j + 1, 2] - u[j, 2]),
        (v[j + 1, 0] - v[j, 0], v[j + 1, 1] - v[j, 1], v[j + 1, 2] - v[j, 2]),
    )


@kernel
def geometric_stretch(model: RodModel, work: RodWork, j: int) -> float:
    """Return the stiffness of segment j across itself: tension over length, zero if compressed."""
    k = model.EA[j] / model.rest_length[j]
    return float(k * max(0.0, work.taut[j]) / max(work.length[j], model.rest_length[j]))


@inlined_kernel
def add_stretch_tangent(model: RodModel, work: RodWork, scale: Scale) -> None:
    """Add the stretch stiffness: along each segment, and the geometric one of a segment in tension."""
    band = work.band
    for j in range(work.length.shape[0]):
        t = row(work.tangent, j)
        k = model.EA[j] / model.rest_length[j]
        geometric = scale[1] * geometric_stretch(model, work, j)
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

    An infinite length stands for a wall, a tangent that no particle turns.
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
def joint_strain(gradient: FloatArray, u: FloatArray, first: int) -> float:
    """Return the strain that displacements u (n, 3) add to a joint of three particles from ``first`` on."""
    strain = 0.0
    for c in range(3):
        strain += gradient[c] * u[first, c] + gradient[3 + c] * u[first + 1, c] + gradient[6 + c] * u[first + 2, c]
    return strain


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


@inlined_kernel
def add_bending(model: RodModel, work: RodWork) -> None:
    """Add the bending forces -k (theta + d theta/dx . lead) d theta/dx, and store what their tangent needs."""
    for i in range(model.joint_stiffness.shape[0]):
        t = row(work.tangent, i)
        u = row(work.tangent, i + 1)
        theta, b = bending_angle(t, u)
        joint_gradient(t, u, (bent_length(model, work, i), bent_length(model, work, i + 1)), b, work.joint[i])
        q, r = work.joint[i, 0], work.joint[i, 1]
        k = model.joint_stiffness[i]
        add_joint_force(q, k * (theta + joint_strain(q, work.lead[0], i)), i, work.force)
        has_plane = theta >= _NO_PLANE
        aside = geometric_bending(theta) if has_plane else 1.0
        strain = joint_strain(r, work.lead[1 if has_plane else 0], i)
        if has_plane and model.has_frame:
            strain += aside * (joint_strain(r, work.lead[0], i) - strain)
        add_joint_force(r, k * aside * strain, i, work.force)
        work.has_plane[i], work.aside[i] = has_plane, aside


@kernel
def bent_length(model: RodModel, work: RodWork, j: int) -> float:
    """Return the length of a segment for bending, at least `SHORTEST` of its rest length."""
    return float(max(work.length[j], SHORTEST * model.rest_length[j]))


@kernel
def bending_excess(model: RodModel, work: RodWork, scale: float) -> float:
    """Return the bending energy [J] after ``scale`` times the solution moves the rod, minus its quadratic model.

    The model is that of the forces and the tangent of `add_bending`, without damping.
    """
    total, before = 0.0, _moved_tangent(work, 0, scale)
    for i in range(model.joint_stiffness.shape[0]):
        after = _moved_tangent(work, i + 1, scale)
        theta, _ = bending_angle(row(work.tangent, i), row(work.tangent, i + 1))
        end, _ = bending_angle(before, after)
        along, aside = 0.0, 0.0
        for c in range(9):
            along += scale * work.joint[i, 0, c] * work.rhs[3 * i + c]
            aside += scale * work.joint[i, 1, c] * work.rhs[3 * i + c]
        quadratic = theta * along + 0.5 * (along * along + work.aside[i] * aside * aside)
        total += model.joint_stiffness[i] * (0.5 * (end * end - theta * theta) - quadratic)
        before = after
    return total


@kernel
def _moved_tangent(work: RodWork, j: int, scale: float) -> Vector:
    """Return the direction of segment j after ``scale`` times the solution moves it; the old one if it vanishes."""
    t, length = row(work.tangent, j), work.length[j]
    edge = (
        length * t[0] + scale * (work.rhs[3 * j + 3] - work.rhs[3 * j]),
        length * t[1] + scale * (work.rhs[3 * j + 4] - work.rhs[3 * j + 1]),
        length * t[2] + scale * (work.rhs[3 * j + 5] - work.rhs[3 * j + 2]),
    )
    end = math.sqrt(dot(edge, edge))
    return scaled(edge, 1.0 / end) if end > 0.0 else t


@inlined_kernel
def add_bending_tangent(model: RodModel, work: RodWork, scale: Scale) -> None:
    """Add the tangent of the bending forces that were added last."""
    for i in range(model.joint_stiffness.shape[0]):
        k = model.joint_stiffness[i]
        add_rank_one(work.band, 3 * i, work.joint[i, 0], scale[0] * k)
        out_of_plane = scale[1 if work.has_plane[i] else 0] * work.aside[i] * k
        if work.has_plane[i] and model.has_frame:
            out_of_plane += (scale[0] - scale[1]) * work.aside[i] ** 2 * k
        add_rank_one(work.band, 3 * i, work.joint[i, 1], out_of_plane)
