"""A guide wire on the axis of a catheter: both bend as one rod, which beyond the catheter's tip is the wire alone.

The model is that of concentric tubes without clearance (Dupont, Lock, Itkowitz and Butler, "Design and control of
concentric-tube robots", IEEE Transactions on Robotics 2010): stiffnesses add, and the rest curvature of the rod is the
mean of both, weighted by stiffness. The wire has two coordinates, its *place*: the length that protrudes from the tip,
and its roll relative to the catheter. The segments beyond the tip divide this length evenly. Positions on the wire are
arc lengths from its own tip. A joint has the integrals of the wire's properties with the linear shape function of its
particle, as in `bodies.sections`, so that a section acts over its own length wherever it lies between the particles.
"""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import Vector, along, cross, dot, put_row, row, scaled, subtract
from trocar.services.mechanics.rod.elasticity import bending_angle
from trocar.services.mechanics.rod.material_frame import Frame

_STEP_M, _STEP_RAD = 1e-5, 1e-4  # steps of difference quotients, far below a noticeable change of the bending


class GuideWireModel(Struct):
    """Properties of wire and catheter, and the arrays of the common rod with n particles; c joints up to the tip."""

    arc: Annotated[FloatArray, "k + 1"]  # ends of the wire's sections from its tip; the last is beyond its end, m
    flexibility: Annotated[FloatArray, "k"]  # of the sections, 1/(N m^2)
    curvature: Annotated[FloatArray, "k", 2]  # of the sections at rest, about m1 and m2, 1/m
    catheter_bending: Annotated[FloatArray, "c"]  # of the joints, and of the half segment before the tip, N m/rad
    catheter_torsion: Annotated[FloatArray, "c"]
    catheter_rest: Annotated[FloatArray, "n - 2", 3]  # its own rest rotation, rad
    joint_stiffness: Annotated[FloatArray, "n - 2"]  # these four are the rod's
    torsion: Annotated[FloatArray, "n - 2"]
    rest_rotation: Annotated[FloatArray, "n - 2", 3]
    rest_length: Annotated[FloatArray, "n - 1"]
    mass: Annotated[FloatArray, "n"]
    drag: Annotated[FloatArray, "n"]
    EA: Annotated[FloatArray, "n - 1"]
    load: Annotated[FloatArray, "n", 3]  # this and the next: scratch
    moment: Annotated[FloatArray, "n - 2", 3]
    density: float  # kg/m
    own_mass: float  # of the catheter's last particle, with the wire inside, kg
    viscous: float  # drag per length, N s/m^2
    own_drag: float  # of the catheter's last particle, N s/m
    poisson: float
    radius: float
    clearance: float  # between wire and lumen, half of the difference of their diameters, m
    friction: float
    tip: int  # particle at the catheter's tip


Place = tuple[float, float]
"""Length of the wire out of the tip, m, and its roll, rad."""
wire_at = reader(GuideWireModel)


@kernel
def write_rod_properties(address: Address[GuideWireModel], place: Place) -> None:
    """Write the properties of the common rod for a place of the wire."""
    wire, last = wire_at(address), wire_at(address).mass.shape[0] - 1
    for i in range(wire.joint_stiffness.shape[0]):
        bending, rest, torsion, twist, _ = _joint(wire, i, place)
        wire.joint_stiffness[i], wire.torsion[i] = bending, torsion
        wire.rest_rotation[i, 0], wire.rest_rotation[i, 1], wire.rest_rotation[i, 2] = rest[0], rest[1], twist
    length = place[0] / (last - wire.tip)
    wire.rest_length[wire.tip :] = length
    wire.mass[wire.tip :], wire.drag[wire.tip :] = wire.density * length, wire.viscous * length
    for p, mass, drag in ((wire.tip, wire.own_mass, wire.own_drag), (last, 0.0, 0.0)):
        wire.mass[p], wire.drag[p] = mass + 0.5 * wire.density * length, drag + 0.5 * wire.viscous * length


@kernel
def stored_energies(address: Address[GuideWireModel], x: FloatArray, frame: Frame, place: Place) -> tuple[float, float]:
    """Return two energies [J] of the rod at ``x`` (n, 3) that depend on the wire's place.

    The first is that of the common rod, the second that of bending wire and catheter to their common rest shape.
    """
    wire = wire_at(address)
    total, misfit_j = _elastic_energies(wire, frame, place)
    length = place[0] / (x.shape[0] - 1 - wire.tip)
    for j in range(wire.tip, x.shape[0] - 1):
        edge = subtract(row(x, j + 1), row(x, j))
        total += 0.5 * wire.EA[j] / length * (math.sqrt(dot(edge, edge)) - length) ** 2
    return total, misfit_j


@kernel
def _elastic_energies(wire: GuideWireModel, frame: Frame, place: Place) -> tuple[float, float]:
    total, misfit_j = 0.0, 0.0
    for i in range(wire.joint_stiffness.shape[0]):
        bending, rest, torsion, twist, joint_misfit_j = _joint(wire, i, place)
        theta, w = _rotation(frame, i)
        change = theta * theta - 2.0 * (w[0] * rest[0] + w[1] * rest[1]) + rest[0] * rest[0] + rest[1] * rest[1]
        total += 0.5 * bending * change + 0.5 * torsion * (frame[2][i] - twist) ** 2
        misfit_j += joint_misfit_j
    return total, misfit_j


@kernel
def _rotation(frame: Frame, i: int) -> tuple[float, Vector]:
    """Return the angle of a joint, and its rotation about m1 and m2 (the mean of both segments' frames)."""
    t, u = row(frame[0], i), row(frame[0], i + 1)
    theta, b = bending_angle(t, u)
    first = along(row(frame[1], i), row(frame[1], i + 1), 1.0)
    second = along(cross(t, row(frame[1], i)), cross(u, row(frame[1], i + 1)), 1.0)
    return theta, (0.5 * theta * dot(b, first), 0.5 * theta * dot(b, second), 0.0)


@kernel
def _piece(
    wire: GuideWireModel, at: float, before: float, after: float, roll: float
) -> tuple[float, float, float, float]:
    """Return the wire's bending stiffness and rest rotation about the catheter's m1 and m2 at a joint.

    The joint lies at an arc length ``at`` from the wire's tip, between segments of the lengths ``before`` and
    ``after``. The last number is the joint's length times the integral of the square of the rest curvature, in rad^2.
    """
    compliance, first, second, squared = 0.0, 0.0, 0.0, 0.0
    for k in range(wire.flexibility.shape[0]):
        start, end = wire.arc[k] - at, wire.arc[k + 1] - at
        length = _part_below(end, before) - _part_below(start, before)
        length += _part_below(-start, after) - _part_below(-end, after)
        a, b = wire.curvature[k, 0], wire.curvature[k, 1]
        compliance += length * wire.flexibility[k]
        first += length * a
        second += length * b
        squared += length * (a * a + b * b)
    cosine, sine = math.cos(roll), math.sin(roll)
    a, b = cosine * first - sine * second, sine * first + cosine * second
    return 1.0 / compliance, a, b, 0.5 * (before + after) * squared


@kernel
def _part_below(place: float, length: float) -> float:
    """Return the integral up to a place of a shape function that falls from 1 at 0 to 0 at ``length``."""
    if place <= 0.0 or length <= 0.0:
        return 0.0
    part = min(place / length, 1.0)
    return length * part * (1.0 - 0.5 * part)


@kernel
def _wire_joint(wire: GuideWireModel, i: int, place: Place) -> tuple[float, float, float, float]:
    """Return what `_piece` returns for the wire at joint i."""
    beyond = place[0] / (wire.mass.shape[0] - 1 - wire.tip)
    before = wire.rest_length[0] if i < wire.tip else beyond
    after = wire.rest_length[0] if i + 1 < wire.tip else beyond
    at = place[0] + (wire.tip - i - 1) * before
    piece: tuple[float, float, float, float] = _piece(wire, at, before, after, place[1])
    return piece


@kernel
def _joint(wire: GuideWireModel, i: int, place: Place) -> tuple[float, tuple[float, float], float, float, float]:
    """Return bending stiffness, rest rotation, torsional stiffness and rest twist of a joint, and an energy in J.

    This is the energy of bending wire and catheter to their common rest shape. It is integrated along the joint: a bend
    of the wire that has entered only a part of the joint has its full curvature there.
    """
    bending, a, b, squared = _wire_joint(wire, i, place)
    shear = 1.0 + wire.poisson
    if i >= wire.tip:
        return bending, (a, b), bending / shear, 0.0, 0.0
    own, own_torsion = wire.catheter_bending[i], wire.catheter_torsion[i]
    if i == wire.tip - 1:  # half of the joint is in the catheter, half of it outside: two springs in series
        inside, a_in, b_in, squared = _piece(wire, place[0], wire.rest_length[0], 0.0, place[1])
        outside = 1.0 / (1.0 / bending - 1.0 / inside)
        both, share = own + inside, own / (own + inside)
        twists = own_torsion + inside / shear
        joint_misfit_j = 0.5 * own * (1.0 - share) * squared
        series, series_torsion = both * outside / (both + outside), twists * outside / (twists * shear + outside)
        return series, (a - share * a_in, b - share * b_in), series_torsion, 0.0, joint_misfit_j
    both, torsion, share = own + bending, own_torsion + bending / shear, own / (own + bending)
    c, d, twist = wire.catheter_rest[i, 0], wire.catheter_rest[i, 1], wire.catheter_rest[i, 2]
    joint_misfit_j = 0.5 * own * (1.0 - share) * (c * c + d * d - 2.0 * (a * c + b * d) + squared)
    held = own_torsion / torsion
    joint_misfit_j += 0.5 * own_torsion * (1.0 - held) * twist * twist
    return both, (a + share * (c - a), b + share * (d - b)), torsion, held * twist, joint_misfit_j


@kernel
def insertion_forces(
    address: Address[GuideWireModel], x: FloatArray, frame: Frame, load: FloatArray, place: Place
) -> tuple[float, float, float, float, float, float]:
    """Return the forces [N] that push the wire out, hold it, and let it in, then torque, its slope and its friction.

    The force at the catheter's tip balances the loads (n, 3) beyond it, and the change of the bending energy with the
    protruding length. From there back, each joint of the catheter adds the coefficient of friction times the normal
    force between wire and catheter, which follows from bending and from the axial force (capstan equation). The torque
    [N m] and its slope [N m/rad] follow from the shape; the last number is the limit of its friction [N m].
    """
    wire, tip = wire_at(address), wire_at(address).tip
    push = _slope(wire, frame, place, (_STEP_M, 0.0))[0]
    for p in range(tip + 1, x.shape[0]):
        push -= dot(row(load, p), subtract(row(x, p), row(x, tip))) / place[0]
    _write_bending_loads(wire, frame, place)
    forward, backward, pressed = push, push, 0.0
    for p in range(tip, 0, -1):
        t, u, own = row(frame[0], p - 1), row(frame[0], p), row(wire.load, p)
        half_forward = 0.5 * wire.friction * _normal_force(own, t, u, forward)
        half_backward = 0.5 * wire.friction * _normal_force(own, t, u, backward)
        forward += wire.friction * _normal_force(own, t, u, forward + half_forward)
        backward -= wire.friction * _normal_force(own, t, u, backward - half_backward)
        pressed += _normal_force(own, t, u, push)
    torque, slope = _slope(wire, frame, place, (0.0, _STEP_RAD))
    return forward, push, backward, torque, slope, wire.friction * wire.radius * pressed


@kernel
def _slope(wire: GuideWireModel, frame: Frame, place: Place, step: Place) -> tuple[float, float]:
    """Return the first two derivatives of the bending and torsion energy along ``step``, at fixed joint angles."""
    size = step[0] + step[1]
    behind, misfit_behind_j = _elastic_energies(wire, frame, (place[0] - step[0], place[1] - step[1]))
    here, misfit_here_j = _elastic_energies(wire, frame, place)
    ahead, misfit_ahead_j = _elastic_energies(wire, frame, (place[0] + step[0], place[1] + step[1]))
    first, second = behind + misfit_behind_j, ahead + misfit_ahead_j
    return (second - first) / (2.0 * size), (second - 2.0 * (here + misfit_here_j) + first) / (size * size)


@kernel
def _normal_force(own: Vector, t: Vector, u: Vector, push: float) -> float:
    """Return the normal force at a joint that bends the wire from t to u, from the load ``own`` and the axial force."""
    middle = along(t, u, 1.0)
    force = along(own, subtract(t, u), push)
    transverse = along(force, middle, -dot(force, middle) / max(dot(middle, middle), 1e-12))
    return math.sqrt(dot(transverse, transverse))


@kernel
def _write_bending_loads(wire: GuideWireModel, frame: Frame, place: Place) -> None:
    """Write the transverse forces of the wire's bending on the catheter, up to the catheter's tip.

    A jump of the bending moment would need infinite forces. In a lumen with the clearance d the wire crosses from one
    side to the other there, and its moment changes linearly over a length a: a change k of the curvature displaces it
    by k a^2 / 24 = 2 d. So moments are averaged over the length a of the sharpest bend.
    """
    sharpest, last = 0.0, wire.joint_stiffness.shape[0] - 1
    wire.load[:] = 0.0
    for i in range(last + 1):
        t, u = row(frame[0], i), row(frame[0], i + 1)
        stiffness, a, b, _ = _wire_joint(wire, i, place)
        theta, axis = bending_angle(t, u)
        m1, n1 = row(frame[1], i), row(frame[1], i + 1)
        moment = scaled(axis, stiffness * theta)
        moment = along(moment, along(m1, n1, 1.0), -0.5 * stiffness * a)
        moment = along(moment, along(cross(t, m1), cross(u, n1), 1.0), -0.5 * stiffness * b)
        put_row(wire.moment, i, moment)
        if i < wire.tip:
            sharpest = max(sharpest, math.sqrt(dot(moment, moment)) / (stiffness * wire.rest_length[0]))
    reach = int(min(0.5 * math.sqrt(48.0 * wire.clearance / max(sharpest, 1e-9)) / wire.rest_length[0], last))
    for i in range(min(wire.tip, last) + 1):
        moment = _averaged_moment(wire, i, reach)
        near = scaled(cross(moment, row(frame[0], i)), 1.0 / wire.rest_length[i])
        far = scaled(cross(moment, row(frame[0], i + 1)), 1.0 / wire.rest_length[i + 1])
        put_row(wire.load, i, subtract(row(wire.load, i), near))
        put_row(wire.load, i + 1, along(along(row(wire.load, i + 1), near, 1.0), far, 1.0))
        put_row(wire.load, i + 2, scaled(far, -1.0))


@kernel
def _averaged_moment(wire: GuideWireModel, i: int, reach: int) -> Vector:
    total, last = (0.0, 0.0, 0.0), wire.joint_stiffness.shape[0] - 1
    for k in range(max(i - reach, 0), min(i + reach, last) + 1):
        total = along(total, row(wire.moment, k), 1.0 / (2 * reach + 1))
    return total
