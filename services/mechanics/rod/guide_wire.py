"""A guide wire on the axis of a catheter: both bend as one rod, and beyond the catheter's tip the wire is alone.

Concentric tubes without clearance (Dupont, Lock, Itkowitz and Butler, "Design and control of concentric-tube robots",
IEEE Transactions on Robotics 2010): stiffnesses add, and the rod's rest curvature is the mean of both, weighted by
stiffness. The wire has two coordinates: its length out of the tip, and its roll against the catheter.
The segments beyond the tip divide that length evenly; places on the wire are counted from its own tip.
"""

from __future__ import annotations

import math
from typing import Annotated

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.compiled.vectors import Vector, along, cross, dot, put_row, row, scaled, subtract
from services.mechanics.rod.elasticity import bending_angle
from services.mechanics.rod.material_frame import Frame

_STEP_M, _STEP_RAD = 1e-5, 1e-4  # steps of difference quotients, far below what changes the bending noticeably


class GuideWireModel(Struct):
    """The wire's material, the catheter's own, and the arrays of the common rod: n particles, c at the tip."""

    arc: Annotated[FloatArray, "k"]  # from the wire's tip, where its sections end; the last is beyond its end, m
    bent: Annotated[FloatArray, "k", 3]  # up to there: angle per moment, rad/(N m), and at rest about m1 and m2, rad
    squared: Annotated[FloatArray, "k"]  # and the sum of the squares of that curvature over the length, rad^2/m
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
    own_mass: float  # of the catheter's last particle, with the wire in it, kg
    viscous: float  # drag of a metre
    own_drag: float
    poisson: float
    radius: float
    clearance: float  # between wire and lumen, half of what their diameters differ by, m
    friction: float
    tip: int  # particle at the catheter's tip


Place = tuple[float, float]
"""Length of the wire out of the tip, m, and its roll, rad."""
wire_at = reader(GuideWireModel)


@kernel
def lay(address: Address[GuideWireModel], place: Place) -> None:
    """Write the properties of the common rod with the wire at a place."""
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
def stored(address: Address[GuideWireModel], x: FloatArray, frame: Frame, place: Place) -> tuple[float, float]:
    """Return the energies [J] of the rod at ``x`` that depend on the wire's place: first that of its present shape.

    The second is the energy of bending wire and catheter to their common rest shape.
    """
    wire = wire_at(address)
    total, against = _bent(wire, frame, place)
    length = place[0] / (x.shape[0] - 1 - wire.tip)
    for j in range(wire.tip, x.shape[0] - 1):
        edge = subtract(row(x, j + 1), row(x, j))
        total += 0.5 * wire.EA[j] / length * (math.sqrt(dot(edge, edge)) - length) ** 2
    return total, against


@kernel
def _bent(wire: GuideWireModel, frame: Frame, place: Place) -> tuple[float, float]:
    total, against = 0.0, 0.0
    for i in range(wire.joint_stiffness.shape[0]):
        bending, rest, torsion, twist, apart = _joint(wire, i, place)
        theta, w = _rotation(frame, i)
        change = theta * theta - 2.0 * (w[0] * rest[0] + w[1] * rest[1]) + rest[0] * rest[0] + rest[1] * rest[1]
        total += 0.5 * bending * change + 0.5 * torsion * (frame[2][i] - twist) ** 2
        against += apart
    return total, against


@kernel
def _rotation(frame: Frame, i: int) -> tuple[float, Vector]:
    """Return the angle of a joint, and its rotation about m1 and m2 (the mean of both segments' frames)."""
    t, u = row(frame[0], i), row(frame[0], i + 1)
    theta, b = bending_angle(t, u)
    first = along(row(frame[1], i), row(frame[1], i + 1), 1.0)
    second = along(cross(t, row(frame[1], i)), cross(u, row(frame[1], i + 1)), 1.0)
    return theta, (0.5 * theta * dot(b, first), 0.5 * theta * dot(b, second), 0.0)


@kernel
def _piece(wire: GuideWireModel, start: float, end: float, roll: float) -> tuple[float, float, float, float]:
    """Return bending stiffness and rest rotation about the catheter's m1, m2 of the wire between two places.

    The last number is the mean square of that rotation if the whole piece were bent as each of its parts.
    """
    bent, squared = (0.0, 0.0, 0.0), 0.0
    for at, sign in ((start, -1.0), (end, 1.0)):
        k = 1
        while k < wire.arc.shape[0] - 1 and wire.arc[k] < at:
            k += 1
        share = (at - wire.arc[k - 1]) / (wire.arc[k] - wire.arc[k - 1])
        bent = along(along(bent, row(wire.bent, k - 1), sign * (1.0 - share)), row(wire.bent, k), sign * share)
        squared += sign * ((1.0 - share) * wire.squared[k - 1] + share * wire.squared[k])
    cosine, sine = math.cos(roll), math.sin(roll)
    a, b = cosine * bent[1] - sine * bent[2], sine * bent[1] + cosine * bent[2]
    return 1.0 / bent[0], a, b, (end - start) * squared


@kernel
def _wire_joint(wire: GuideWireModel, i: int, place: Place) -> tuple[float, float, float, float]:
    """Return the properties of the wire alone at joint i: half a segment on either side of it."""
    beyond = place[0] / (wire.mass.shape[0] - 1 - wire.tip)
    before = wire.rest_length[0] if i < wire.tip else beyond
    after = wire.rest_length[0] if i + 1 < wire.tip else beyond
    at = place[0] + (wire.tip - i - 1) * before
    piece: tuple[float, float, float, float] = _piece(wire, at - 0.5 * after, at + 0.5 * before, place[1])
    return piece


@kernel
def _joint(wire: GuideWireModel, i: int, place: Place) -> tuple[float, tuple[float, float], float, float, float]:
    """Bending stiffness, rest rotation, torsional stiffness and rest twist of a joint, and what both hold, J.

    They hold each other all along it, as they are bent at rest in each place: a bend that comes in by a part of a joint
    is no less bent there.
    """
    bending, a, b, squared = _wire_joint(wire, i, place)
    shear = 1.0 + wire.poisson
    if i >= wire.tip:
        return bending, (a, b), bending / shear, 0.0, 0.0
    own, own_torsion = wire.catheter_bending[i], wire.catheter_torsion[i]
    if i == wire.tip - 1:  # half of it in the catheter, half of it out: one behind the other
        inside, a_in, b_in, squared = _piece(wire, place[0], place[0] + 0.5 * wire.rest_length[0], place[1])
        outside = 1.0 / (1.0 / bending - 1.0 / inside)
        both, share = own + inside, own / (own + inside)
        twists = own_torsion + inside / shear
        apart = 0.5 * own * (1.0 - share) * squared
        series, turns = both * outside / (both + outside), twists * outside / (twists * shear + outside)
        return series, (a - share * a_in, b - share * b_in), turns, 0.0, apart
    both, torsion, share = own + bending, own_torsion + bending / shear, own / (own + bending)
    c, d, twist = wire.catheter_rest[i, 0], wire.catheter_rest[i, 1], wire.catheter_rest[i, 2]
    apart = 0.5 * own * (1.0 - share) * (c * c + d * d - 2.0 * (a * c + b * d) + squared)
    held = own_torsion / torsion
    apart += 0.5 * own_torsion * (1.0 - held) * twist * twist
    return both, (a + share * (c - a), b + share * (d - b)), torsion, held * twist, apart


@kernel
def resist(
    address: Address[GuideWireModel], x: FloatArray, frame: Frame, load: FloatArray, place: Place
) -> tuple[float, float, float, float, float, float]:
    """Return the pushes [N] that move the wire out, hold it, and let it in, then torque, its slope and its friction.

    The push at the wire's tip opposes the loads (n, 3) beyond the catheter's tip and the bending on the wire's way out.
    On the way back each joint of the catheter adds friction times the force that holds the wire on the curve, from its
    bending and from the push (the capstan). The torque [N m] and its slope [N m/rad] follow from the shape; friction
    limits the last torque [N m].
    """
    wire, tip = wire_at(address), wire_at(address).tip
    push = _slope(wire, frame, place, (_STEP_M, 0.0))[0]
    for p in range(tip + 1, x.shape[0]):
        push -= dot(row(load, p), subtract(row(x, p), row(x, tip))) / place[0]
    _bend_loads(wire, frame, place)
    forward, backward, pressed = push, push, 0.0
    for p in range(tip, 0, -1):
        t, u, own = row(frame[0], p - 1), row(frame[0], p), row(wire.load, p)
        halfway = 0.5 * wire.friction * _across(own, t, u, forward), 0.5 * wire.friction * _across(own, t, u, backward)
        forward += wire.friction * _across(own, t, u, forward + halfway[0])
        backward -= wire.friction * _across(own, t, u, backward - halfway[1])
        pressed += _across(own, t, u, push)
    torque, slope = _slope(wire, frame, place, (0.0, _STEP_RAD))
    return forward, push, backward, torque, slope, wire.friction * wire.radius * pressed


@kernel
def _slope(wire: GuideWireModel, frame: Frame, place: Place, step: Place) -> tuple[float, float]:
    """Return both derivatives of the bending and torsion energy by the wire's place, at fixed angles of the joints."""
    size = step[0] + step[1]
    behind, apart_behind = _bent(wire, frame, (place[0] - step[0], place[1] - step[1]))
    here, apart_here = _bent(wire, frame, place)
    ahead, apart_ahead = _bent(wire, frame, (place[0] + step[0], place[1] + step[1]))
    first, second = behind + apart_behind, ahead + apart_ahead
    return (second - first) / (2.0 * size), (second - 2.0 * (here + apart_here) + first) / (size * size)


@kernel
def _across(own: Vector, t: Vector, u: Vector, push: float) -> float:
    """Return the force across the wire at a joint that bends it from t to u, and bears a push along it."""
    middle = along(t, u, 1.0)
    force = along(own, subtract(t, u), push)
    beside = along(force, middle, -dot(force, middle) / max(dot(middle, middle), 1e-12))
    return math.sqrt(dot(beside, beside))


@kernel
def _bend_loads(wire: GuideWireModel, frame: Frame, place: Place) -> None:
    """Write the forces with which the wire's bending presses on the axis, up to the catheter's tip.

    Where its moment jumps, forces over no length would have to hold it. In a lumen with the clearance d the wire goes
    from one side to the other there: its moment changes evenly over a length a by which a change k of curvature moves
    it aside by k a^2 / 24 = 2 d. So moments are averaged over a, that of the sharpest bend.
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
        moment = _averaged(wire, i, reach)
        near = scaled(cross(moment, row(frame[0], i)), 1.0 / wire.rest_length[i])
        far = scaled(cross(moment, row(frame[0], i + 1)), 1.0 / wire.rest_length[i + 1])
        put_row(wire.load, i, subtract(row(wire.load, i), near))
        put_row(wire.load, i + 1, along(along(row(wire.load, i + 1), near, 1.0), far, 1.0))
        put_row(wire.load, i + 2, scaled(far, -1.0))


@kernel
def _averaged(wire: GuideWireModel, i: int, reach: int) -> Vector:
    total, last = (0.0, 0.0, 0.0), wire.joint_stiffness.shape[0] - 1
    for k in range(max(i - reach, 0), min(i + reach, last) + 1):
        total = along(total, row(wire.moment, k), 1.0 / (2 * reach + 1))
    return total
