"""Torsion and rest curvature of the material frame, in torsional equilibrium at every step.

Torsional waves are some hundred times faster than bending, so the frames have no inertia: they take the angles of least
energy (a tridiagonal Newton step), held up only by the damping of bending (`elasticity`). The roll of the first
director is prescribed, that of the last one may be.

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

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import Vector, along, cross, dot, put_row, row, scaled, subtract
from trocar.services.mechanics.rod.elasticity import SHORTEST, bending_angle, geometric_bending
from trocar.services.mechanics.rod.material_frame import NO_WALLS, Frame, follow, initial_frame, rotate_frame
from trocar.services.mechanics.rod.properties import RodProperties
from trocar.services.mechanics.rod.state import RodState

SHARPEST = 1e-2  # 1 + cos of the bending angle below which the holonomy gradient grows no further (a fold of 168 deg)


class TwistModel(Struct):
    """The m directors of a rod, those in walls included, and the tridiagonal system of their angles."""

    torsion: Annotated[FloatArray, "m - 1"]  # of the joints, N m/rad
    bending: Annotated[FloatArray, "m - 1"]
    rest_rotation: Annotated[FloatArray, "m - 1", 3]  # in the material frame, rad
    diagonal: Annotated[FloatArray, "m"]
    coupling: Annotated[FloatArray, "m - 1"]  # minus the other diagonal
    aside: Annotated[FloatArray, "m - 1", 3]  # moment of a joint on its sides as its material turns, N m/rad
    angle: Annotated[FloatArray, "m"]
    turned: Annotated[FloatArray, "m"]  # angles by which equilibrium has turned the directors in this step, rad
    tangent: Annotated[FloatArray, "m", 3]  # these three: scratch, a frame elsewhere
    m1: Annotated[FloatArray, "m", 3]
    twist: Annotated[FloatArray, "m - 1"]
    walls: Annotated[FloatArray, 2, 3]  # directions of clamped ends; NaN rows where an end may turn
    first: int  # row of the first segment, 1 behind a wall
    shortest: float  # a segment crushed below this counts as that long, m
    beta: float  # Kelvin-Voigt damping of the material, s


Task = tuple[Address[TwistModel], Frame, bool]
Motion = tuple[FloatArray, FloatArray]
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
    half_joint = 2.0 * properties.per_end("torsional_stiffness_n_m2") / properties.segment_length_m
    torsion[0], torsion[-1] = half_joint[0, 0], half_joint[-1, 1]
    torsion[joints] = properties.joint_stiffness_n_m("torsional_stiffness_n_m2")
    bending[joints] = properties.joint_stiffness_n_m()
    if properties.rest_curvature_1_m is not None:
        rest[joints] = properties.segment_length_m * np.asarray(properties.rest_curvature_1_m)
    return TwistModel(
        torsion=torsion,
        bending=bending,
        rest_rotation=rest,
        diagonal=np.zeros(n_directors),
        coupling=np.zeros(n_directors - 1),
        aside=np.zeros((n_directors - 1, 3)),
        angle=np.zeros(n_directors),
        turned=np.zeros(n_directors),
        tangent=np.zeros((n_directors, 3)),
        m1=np.zeros((n_directors, 3)),
        twist=np.zeros(n_directors - 1),
        walls=walls,
        first=at_start,
        shortest=SHORTEST * properties.segment_length_m,
        beta=float(properties.internal_damping_s),
    )


def frame_task(model: TwistModel, state: RodState) -> Task:
    """Return the frame of ``state`` for kernels; a state without one gets one without twist.

    Raises ValueError if the frame was made for other clamped ends.
    """
    if state.frame is None:
        state.frame = initial_frame(state.position_m, walls=model.walls)
    if len(state.frame.m1) != len(model.angle):
        raise ValueError(
            f"the rod has {len(state.frame.m1)} directors, not {len(model.angle)}: make its initial_frame with the "
            "wall_directions of its supports"
        )
    return model.address, (state.frame.tangent, state.frame.m1, state.frame.twist_rad), state.frame.end_is_held


def add_frame_forces(model: TwistModel, state: RodState, force_n: FloatArray) -> None:
    """Bring the frames of ``state`` to its positions and to torsional equilibrium, and add their forces to ``force_n``.

    Raises ValueError if the frame was made for other clamped ends.
    """
    update_frame(frame_task(model, state), (state.position_m, state.velocity_m_s), (math.inf, False), force_n)


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
    _write_equilibrium(model, there)
    _turn(model, there, end_is_held)
    return float(_energy(model, there))


@kernel
def update_frame(task: Task, motion: Motion, step: tuple[float, bool], f: FloatArray) -> None:
    """Bring a frame to the middle of a step and to equilibrium there, with damping, and add its forces to f (n, 3).

    ``motion`` are positions and velocities (n, 3) there; ``step`` is (dt, whether the frame comes there a second time).

    An implicit step takes its other forces there too. At rest, the elastic moment of a curved joint and that of its
    rest curvature cancel. Taken at two places, they would leave a force that adds energy. The step takes these forces
    as given numbers; its matrix contains their change while the directors stay (`turning`).
    """
    model, frame, end_is_held = twist_at(task[0]), task[1], task[2]
    lag = model.beta / step[0]
    if not step[1]:
        model.turned[:] = 0.0
    follow(motion[0], frame, model.first)
    _write_equilibrium(model, frame)
    if lag > 0.0:
        _add_damping(model, frame, motion, lag)
    _turn(model, frame, end_is_held)
    for j in range(model.angle.shape[0]):
        model.turned[j] += model.angle[j]
    add_forces(model, motion[0], frame, lag, f)


@kernel
def _write_equilibrium(model: TwistModel, frame: Frame) -> None:
    """Write the moments on the directors and their matrix.

    The matrix is the tridiagonal one of torsion plus the positive part of the diagonal terms of rest curvature.
    """
    diagonal, angle = model.diagonal, model.angle
    diagonal[:] = 0.0
    angle[:] = 0.0
    for i in range(model.torsion.shape[0]):
        moment = model.torsion[i] * (frame[2][i] - model.rest_rotation[i, 2])
        angle[i] += moment
        angle[i + 1] -= moment
        diagonal[i] += model.torsion[i]
        diagonal[i + 1] += model.torsion[i]
        model.coupling[i] = model.torsion[i]
        if _has_rest_curvature(model, i):
            _add_rest_curvature_moments(model, frame, i)


@kernel
def _add_damping(model: TwistModel, frame: Frame, motion: Motion, lag: float) -> None:
    """Add the moments of `elasticity`'s damping out of the planes of joints, and their matrix."""
    (x, v), diagonal, angle = motion, model.diagonal, model.angle
    for p in range(1, x.shape[0] - 1):
        i = p - 1 + model.first
        theta, b = bending_angle(row(frame[0], i), row(frame[0], i + 1))
        before, after = inverse_lengths(model, x, p)
        near, far = subtract(row(v, p), row(v, p - 1)), subtract(row(v, p + 1), row(v, p))
        b = scaled(b, geometric_bending(theta) * model.bending[i] * theta)
        stiffness = 0.25 * lag * model.bending[i] * theta * theta
        tilting = after * dot(b, far) - before * dot(b, near)
        moment = 0.5 * model.beta * tilting - 2.0 * stiffness * _turned(model, i)
        put_row(model.aside, i, b)
        angle[i] += moment
        angle[i + 1] += moment
        diagonal[i] += stiffness
        diagonal[i + 1] += stiffness
        model.coupling[i] -= stiffness


@kernel
def _turn(model: TwistModel, frame: Frame, end_is_held: bool) -> None:
    """Solve for the angles, and turn the directors by them: a Newton step, exact for a rod without rest curvature."""
    diagonal, coupling, angle = model.diagonal, model.coupling, model.angle
    n = angle.shape[0]
    last = n - 1 if end_is_held else n
    angle[0] = 0.0
    angle[last:] = 0.0
    for j in range(2, last):
        factor = coupling[j - 1] / diagonal[j - 1]
        diagonal[j] -= factor * coupling[j - 1]
        angle[j] += factor * angle[j - 1]
    for j in range(last - 1, 0, -1):
        carried = coupling[j] * angle[j + 1] if j + 1 < last else 0.0
        angle[j] = (angle[j] + carried) / diagonal[j]
        rotate_frame(frame, j, angle[j])


@kernel
def _turned(model: TwistModel, i: int) -> float:
    """Return the angle by which the material of a joint has been turned in this step, without a hand's roll."""
    return float(0.5 * (model.turned[i] + model.turned[i + 1]))


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
def add_forces(model: TwistModel, x: FloatArray, frame: Frame, lag: float, f: FloatArray) -> None:
    """Add to f (n, 3) minus the gradient of torsion and rest curvature at fixed angles, and the damping of their turn.

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
        if lag > 0.0:
            b = scaled(row(model.aside, i), lag * _turned(model, i))
            g, h = along(g, b, 1.0), along(h, b, -1.0)
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
