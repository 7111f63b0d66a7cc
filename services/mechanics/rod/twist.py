"""Torsion and rest curvature of the material frame, in torsional equilibrium at every step.

Torsional waves are some hundred times faster than bending, so the frames always take the angles of least energy (a
tridiagonal Newton step) and have no inertia. The roll of the first director is prescribed, that of the last one may be.

Torsion: ``kt/2 (m - m0)^2``, kt = GJ/l0, m the twist of a joint. Between the wall of a clamped end and its segment is
half a joint, kt = 2 GJ/l0, as there is for bending: the rod twists over all of its length. Rest curvature changes the
bending energy ``k/2 |w|^2`` (w = theta b, the rotation vector of the joint) into ``k/2 |w - w0|^2``; w0 turns with the
frames. At equilibrium angles the forces on the particles are the gradient at fixed angles. They sum to zero;
the support that prescribes the roll balances their moment.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.compiled.vectors import Vector, cross, dot, row
from services.mechanics.rod.elasticity import SHORTEST, bending_angle
from services.mechanics.rod.material_frame import NO_WALLS, Frame, expect_middle, follow, initial_frame, rotate_frame
from services.mechanics.rod.properties import RodProperties
from services.mechanics.rod.state import RodState

SHARPEST = 1e-2  # 1 + cos of the bending angle below which the holonomy gradient grows no further (a fold of 168 deg)


class TwistModel(Struct):
    """The m directors of a rod, those in walls included, and the tridiagonal system of their angles."""

    torsion: Annotated[FloatArray, "m - 1"]  # of the joints, N m/rad
    bending: Annotated[FloatArray, "m - 1"]
    rest_rotation: Annotated[FloatArray, "m - 1", 3]  # in the material frame, rad
    diagonal: Annotated[FloatArray, "m"]
    angle: Annotated[FloatArray, "m"]
    tangent: Annotated[FloatArray, "m", 3]  # these three: scratch, a frame elsewhere
    m1: Annotated[FloatArray, "m", 3]
    twist: Annotated[FloatArray, "m - 1"]
    walls: Annotated[FloatArray, 2, 3]  # directions of clamped ends; NaN rows where an end may turn
    first: int  # row of the first segment, 1 behind a wall
    shortest: float  # a segment crushed below this counts as that long, m


Task = tuple[Address[TwistModel], Frame, bool]
twist_at = reader(TwistModel)


def build_twist_model(properties: RodProperties, walls: FloatArray = NO_WALLS) -> TwistModel | None:
    """Return the arrays of the material frame, or None for a rod without torsional stiffness.

    ``walls`` (2, 3) are the directions of clamped ends, NaN where there is none.
    """
    if properties.torsional_stiffness_n_m2 is None:
        return None
    at_start, at_end = (int(is_wall) for is_wall in ~np.isnan(walls[:, 0]))
    n_directors, joints = (
        at_start + properties.n_segments + at_end,
        slice(at_start, at_start + properties.n_segments - 1),
    )
    torsion, bending, rest = np.zeros(n_directors - 1), np.zeros(n_directors - 1), np.zeros((n_directors - 1, 3))
    half_joint = 2.0 * properties.per_segment("torsional_stiffness_n_m2") / properties.segment_length_m
    torsion[0], torsion[-1] = half_joint[0], half_joint[-1]
    torsion[joints] = properties.joint_stiffness_n_m("torsional_stiffness_n_m2")
    bending[joints] = properties.joint_stiffness_n_m()
    if properties.rest_curvature_1_m is not None:
        rest[joints] = properties.segment_length_m * np.asarray(properties.rest_curvature_1_m)
    return TwistModel(
        torsion=torsion,
        bending=bending,
        rest_rotation=rest,
        diagonal=np.zeros(n_directors),
        angle=np.zeros(n_directors),
        tangent=np.zeros((n_directors, 3)),
        m1=np.zeros((n_directors, 3)),
        twist=np.zeros(n_directors - 1),
        walls=walls,
        first=at_start,
        shortest=SHORTEST * properties.segment_length_m,
    )


def add_frame_forces(model: TwistModel, state: RodState, force_n: FloatArray, *, of_next_step: bool = False) -> None:
    """Bring the frames of ``state`` to its positions and to torsional equilibrium, and add their forces to ``force_n``.

    With ``of_next_step`` the positions are those that `expect_middle` predicts for the middle of the next step, to
    second order; call it once before each step then. The forces enter a step as given numbers; the implicit matrix
    contains their change while the directors stay (`turning`).

    Raises ValueError if the frame was made for other clamped ends.
    """
    if state.frame is None:
        state.frame = initial_frame(state.position_m, walls=model.walls)
    if len(state.frame.m1) != len(model.angle):
        raise ValueError(
            f"the rod has {len(state.frame.m1)} directors, not {len(model.angle)}: make its initial_frame with the "
            "wall_directions of its supports"
        )
    frame = (state.frame.tangent, state.frame.m1, state.frame.twist_rad)
    task = (model.address, frame, state.frame.end_is_held)
    if of_next_step:
        _update_ahead(task, state.position_m, state.frame.path(state.position_m), force_n)
    else:
        _update(task, state.position_m, force_n)


def twist_energy(model: TwistModel, state: RodState) -> float:
    """Return the energy [J] of torsion and of rest curvature beyond a straight rod's bending, at the present frames."""
    if state.frame is None:
        return 0.0
    frame = (state.frame.tangent, state.frame.m1, state.frame.twist_rad)
    return float(_energy(model, frame))


@kernel
def energy_at(task: Task, x: FloatArray) -> float:
    """Return `twist_energy` of a frame that follows particles at ``x`` (n, 3); the task's frame is not changed."""
    model, (tangent, m1, twist), end_is_held = twist_at(task[0]), task[1], task[2]
    for j in range(tangent.shape[0]):
        for c in range(3):
            model.tangent[j, c], model.m1[j, c] = tangent[j, c], m1[j, c]
    for i in range(twist.shape[0]):
        model.twist[i] = twist[i]
    there = (model.tangent, model.m1, model.twist)
    follow(x, there, model.first)
    relax(model, there, end_is_held)
    return float(_energy(model, there))


@kernel
def _update_ahead(task: Task, x: FloatArray, path: FloatArray, f: FloatArray) -> None:
    expect_middle(x, path)
    _update(task, path[1], f)


@kernel
def _update(task: Task, x: FloatArray, f: FloatArray) -> None:
    model, frame, end_is_held = twist_at(task[0]), task[1], task[2]
    follow(x, frame, model.first)
    relax(model, frame, end_is_held)
    add_forces(model, x, frame, f)


@kernel
def relax(model: TwistModel, frame: Frame, end_is_held: bool) -> None:
    """Take one Newton step of the angles towards least energy; it is exact for a rod without rest curvature.

    The matrix is the torsion's tridiagonal one plus the positive part of the diagonal terms of rest curvature.
    """
    diagonal, angle = model.diagonal, model.angle
    n = angle.shape[0]
    last = n - 1 if end_is_held else n
    for j in range(n):
        diagonal[j] = 0.0
        angle[j] = 0.0
    for i in range(n - 1):
        moment = model.torsion[i] * (frame[2][i] - model.rest_rotation[i, 2])
        angle[i] += moment
        angle[i + 1] -= moment
        diagonal[i] += model.torsion[i]
        diagonal[i + 1] += model.torsion[i]
        if _has_rest_curvature(model, i):
            _add_rest_curvature_moments(model, frame, i)
    for j in range(2, last):
        factor = model.torsion[j - 1] / diagonal[j - 1]
        diagonal[j] -= factor * model.torsion[j - 1]
        angle[j] += factor * angle[j - 1]
    for j in range(last - 1, 0, -1):
        carried = model.torsion[j] * angle[j + 1] if j + 1 < last else 0.0
        angle[j] = (angle[j] + carried) / diagonal[j]
        rotate_frame(frame, j, angle[j])


@kernel
def _has_rest_curvature(model: TwistModel, i: int) -> bool:
    return bool(model.rest_rotation[i, 0] != 0.0 or model.rest_rotation[i, 1] != 0.0)


@kernel
def _joint_rotation(frame: Frame, i: int) -> Vector:
    """Return the rotation vector w = theta b of a joint."""
    theta, b = bending_angle(row(frame[0], i), row(frame[0], i + 1))
    return (theta * b[0], theta * b[1], theta * b[2])


@kernel
def _rest_vector(model: TwistModel, frame: Frame, i: int, j: int) -> tuple[Vector, Vector]:
    """Return half the rest rotation of joint i in segment j's frame, and its derivative by that frame's angle."""
    m = row(frame[1], j)
    m2 = cross(row(frame[0], j), m)
    a = 0.5 * model.rest_rotation[i, 0]
    b = 0.5 * model.rest_rotation[i, 1]
    return (
        (a * m[0] + b * m2[0], a * m[1] + b * m2[1], a * m[2] + b * m2[2]),
        (a * m2[0] - b * m[0], a * m2[1] - b * m[1], a * m2[2] - b * m[2]),
    )


@kernel
def _add_rest_curvature_moments(model: TwistModel, frame: Frame, i: int) -> None:
    diagonal, angle = model.diagonal, model.angle
    w = _joint_rotation(frame, i)
    for j in (i, i + 1):
        rest, turned = _rest_vector(model, frame, i, j)
        angle[j] += model.bending[i] * dot(w, turned)
        diagonal[j] += max(model.bending[i] * dot(w, rest), 0.0)


@kernel
def add_forces(model: TwistModel, x: FloatArray, frame: Frame, f: FloatArray) -> None:
    """Add to f (n, 3) minus the gradient of torsion and rest curvature at fixed angles.

    The twist of a joint depends on the positions through the transport: its gradient by either edge is
    (t x u)/(1 + t.u) over the edge's length. A wall does not turn.
    """
    last = x.shape[0] - 1
    for i in range(model.torsion.shape[0]):
        t = row(frame[0], i)
        u = row(frame[0], i + 1)
        moment = model.torsion[i] * (frame[2][i] - model.rest_rotation[i, 2])
        b = cross(t, u)
        s = moment / max(1.0 + dot(t, u), SHARPEST)
        g = (s * b[0], s * b[1], s * b[2])
        h = g
        if _has_rest_curvature(model, i):
            g, h = _rest_curvature_gradient(model, frame, i, g)
        p = i + 1 - model.first
        before, after = inverse_lengths(model, x, p)
        for c in range(3):
            if p > 0:
                f[p - 1, c] += g[c] * before
            f[p, c] += h[c] * after - g[c] * before
            if p < last:
                f[p + 1, c] -= h[c] * after


@kernel
def inverse_lengths(model: TwistModel, x: FloatArray, p: int) -> tuple[float, float]:
    """Return the inverse lengths of the segments before and behind particle p; 0.0 where there is none."""
    before = 1.0 / max(_distance(x, p - 1), model.shortest) if p > 0 else 0.0
    after = 1.0 / max(_distance(x, p), model.shortest) if p < x.shape[0] - 1 else 0.0
    return before, after


@kernel
def _distance(x: FloatArray, j: int) -> float:
    e = (x[j + 1, 0] - x[j, 0], x[j + 1, 1] - x[j, 1], x[j + 1, 2] - x[j, 2])
    return math.sqrt(dot(e, e))


@kernel
def _rest_curvature_gradient(model: TwistModel, frame: Frame, i: int, g: Vector) -> tuple[Vector, Vector]:
    """Add to g the gradient of -k w.w0 by the directions of both edges: (by the edge before, by the edge behind)."""
    t = row(frame[0], i)
    u = row(frame[0], i + 1)
    near, _ = _rest_vector(model, frame, i, i)
    far, _ = _rest_vector(model, frame, i, i + 1)
    rest = (near[0] + far[0], near[1] + far[1], near[2] + far[2])
    stretch, slope = _angle_over_sine(bending_angle(t, u)[0])
    overlap = slope * dot(cross(t, u), rest)
    by_t = cross(u, rest)
    by_u = cross(rest, t)
    k = -model.bending[i]
    return (
        _projected(t, by_t, u, (k * stretch, k * overlap), g),
        _projected(u, by_u, t, (k * stretch, k * overlap), g),
    )


@kernel
def _projected(t: Vector, a: Vector, b: Vector, factor: tuple[float, float], offset: Vector) -> Vector:
    """Return ``offset`` + the part normal to t of factor[0] a + factor[1] b."""
    v = (factor[0] * a[0] + factor[1] * b[0], factor[0] * a[1] + factor[1] * b[1], factor[0] * a[2] + factor[1] * b[2])
    along = dot(t, v)
    return (offset[0] + v[0] - along * t[0], offset[1] + v[1] - along * t[1], offset[2] + v[2] - along * t[2])


@kernel
def _angle_over_sine(theta: float) -> tuple[float, float]:
    """Return theta/sin(theta), which makes t x u the rotation vector, and its derivative by cos(theta)."""
    if theta < 1e-3:
        return 1.0 + theta * theta / 6.0, -1.0 / 3.0 - 2.0 / 15.0 * theta * theta
    sine = max(math.sin(theta), 1e-3)
    return theta / sine, -(sine - theta * math.cos(theta)) / sine**3


@kernel
def _energy(model: TwistModel, frame: Frame) -> float:
    total = 0.0
    for i in range(model.torsion.shape[0]):
        total += 0.5 * model.torsion[i] * (frame[2][i] - model.rest_rotation[i, 2]) ** 2
        if _has_rest_curvature(model, i):
            w = _joint_rotation(frame, i)
            near, _ = _rest_vector(model, frame, i, i)
            far, _ = _rest_vector(model, frame, i, i + 1)
            a = model.rest_rotation[i, 0]
            b = model.rest_rotation[i, 1]
            total += model.bending[i] * (0.5 * (a * a + b * b) - dot(w, near) - dot(w, far))
    return total
