"""Kernels of `warping`: finite rotations, the axis strung together, nodes carried along and their derivatives."""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel, summing_kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import Vector, copy_rows


class WarpedTube(Struct):
    """A duct of n nodes along s stations of its axis, with r modes, and its axis in one state."""

    rest_centre: Annotated[FloatArray, "s", 3]  # of the stations
    turn_modes: Annotated[FloatArray, "s", 3, "r"]
    stretch_modes: Annotated[FloatArray, "s - 1", 3, "r"]
    segment: Annotated[IntArray, "n"]  # where each node is along the axis, and how far along that segment
    fraction: Annotated[FloatArray, "n"]
    arm: Annotated[FloatArray, "n", 3]
    local: Annotated[FloatArray, "n", 3, "r"]  # modes
    q: Annotated[FloatArray, "r"]  # the state, and what the stations are in it
    turn: Annotated[FloatArray, "s", 3]
    centre: Annotated[FloatArray, "s", 3]
    rate: Annotated[FloatArray, "s", 3, "r"]  # derivatives of the centres
    small: Annotated[FloatArray, 12, 3]  # scratch: a few matrices and vectors, and turns per modal coordinate
    between: Annotated[FloatArray, 3, "r"]
    has_rates: bool = False  # whether those derivatives are of this state


tube_at = reader(WarpedTube)
SMALL_ANGLE = 1e-4
"""Below it the series are exact to rounding; the quotients lose digits."""


@kernel
def rotation_matrix(turn: FloatArray, out: FloatArray) -> None:
    """Write exp of the cross-product matrix of ``turn`` (3,) into ``out`` (3, 3): Rodrigues' formula."""
    squared = turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2
    angle = math.sqrt(squared)
    if angle < SMALL_ANGLE:
        first, second = 1.0 - squared / 6.0, 0.5 - squared / 24.0
    else:
        first, second = math.sin(angle) / angle, (1.0 - math.cos(angle)) / squared
    _series(turn, first, second, squared, out)


@kernel
def left_jacobian(turn: FloatArray, out: FloatArray) -> None:
    """Write into ``out`` (3, 3) the map from a change of ``turn`` (3,) to the spatial rotation it makes."""
    squared = turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2
    angle = math.sqrt(squared)
    if angle < SMALL_ANGLE:
        first, second = 0.5 - squared / 24.0, 1.0 / 6.0 - squared / 120.0
    else:
        first = (1.0 - math.cos(angle)) / squared
        second = (angle - math.sin(angle)) / (angle * squared)
    _series(turn, first, second, squared, out)


@kernel
def _series(w: FloatArray, first: float, second: float, squared: float, out: FloatArray) -> None:
    """Write 1 + first [w]x + second [w]x^2."""
    for i in range(3):
        for j in range(3):
            out[i, j] = second * w[i] * w[j]
        out[i, i] += 1.0 - second * squared
    out[0, 1] -= first * w[2]
    out[0, 2] += first * w[1]
    out[1, 0] += first * w[2]
    out[1, 2] -= first * w[0]
    out[2, 0] -= first * w[1]
    out[2, 1] += first * w[0]


@kernel
def interpolate_turn(turn: FloatArray, segment: int, fraction: float, out: FloatArray) -> None:
    """Write the rotation vector (3,) at a place between two stations."""
    for i in range(3):
        out[i] = (1.0 - fraction) * turn[segment, i] + fraction * turn[segment + 1, i]


@summing_kernel
def _product(modes: FloatArray, q: FloatArray, out: FloatArray) -> None:
    x, y, z = 0.0, 0.0, 0.0
    for mode in range(q.shape[0]):
        x += modes[0, mode] * q[mode]
        y += modes[1, mode] * q[mode]
        z += modes[2, mode] * q[mode]
    out[0], out[1], out[2] = x, y, z


@kernel
def _rotate(R: FloatArray, vector: FloatArray, out: FloatArray) -> None:
    """Write R ``vector``; both may be the same."""
    x, y, z = vector[0], vector[1], vector[2]
    for i in range(3):
        out[i] = R[i, 0] * x + R[i, 1] * y + R[i, 2] * z


@kernel
def _rotate_back(R: FloatArray, vector: FloatArray, out: FloatArray) -> None:
    """Write R^T ``vector``; both may be the same."""
    x, y, z = vector[0], vector[1], vector[2]
    for i in range(3):
        out[i] = R[0, i] * x + R[1, i] * y + R[2, i] * z


@kernel
def _turn_of_arm(A: FloatArray, arm: FloatArray, out: FloatArray) -> None:
    """Write the map (3, 3) from a change w of a turn to what it moves a point by: (A w) x arm."""
    for j in range(3):
        x, y, z = A[0, j], A[1, j], A[2, j]
        out[0, j] = y * arm[2] - z * arm[1]
        out[1, j] = z * arm[0] - x * arm[2]
        out[2, j] = x * arm[1] - y * arm[0]


@kernel
def _add_rotated(R: FloatArray, modes: FloatArray, out: FloatArray) -> None:
    """Add R modes, (3, 3) by (3, r), to ``out``: each row by itself, so that several modes are done at once."""
    for i in range(3):
        x, y, z = R[i, 0], R[i, 1], R[i, 2]
        for mode in range(out.shape[1]):
            out[i, mode] += x * modes[0, mode] + y * modes[1, mode] + z * modes[2, mode]


@kernel
def update_axis(address: Address[WarpedTube], q: FloatArray) -> bool:
    """String the stations of a tube together at coordinates q (r,); False where that has been done already."""
    return string_axis(tube_at(address), q)


@kernel
def string_axis(tube: WarpedTube, q: FloatArray) -> bool:
    """Do as `update_axis`: write the turns and centres of the stations, unless they are those at q (r,)."""
    if _is_strung(tube, q):
        return False
    _begin_axis(tube, q)
    centres, turn_modes, stretch = tube.rest_centre, tube.turn_modes, tube.stretch_modes
    turn, centre, small = tube.turn, tube.centre, tube.small
    R, middle, piece, step = small[:3], small[6], small[7], small[8]
    for station in range(turn.shape[0]):
        _product(turn_modes[station], q, turn[station])
    for i in range(3):
        centre[0, i] = centres[0, i]
    for k in range(stretch.shape[0]):
        interpolate_turn(turn, k, 0.5, middle)
        rotation_matrix(middle, R)
        _product(stretch[k], q, piece)
        for i in range(3):
            piece[i] += centres[k + 1, i] - centres[k, i]
        _rotate(R, piece, step)
        for i in range(3):
            centre[k + 1, i] = centre[k, i] + step[i]
    return True


@kernel
def take_axis(source: WarpedTube, q: FloatArray, tube: WarpedTube) -> bool:
    """Do as `string_axis`, by copying the axis of another tube of the same duct if that has been strung at q (r,)."""
    if _is_strung(tube, q):
        return False
    if not _is_strung(source, q):
        return string_axis(tube, q)
    _begin_axis(tube, q)
    copy_rows(source.turn, tube.turn, tube.turn.shape[0])
    copy_rows(source.centre, tube.centre, tube.centre.shape[0])
    return True


@kernel
def _begin_axis(tube: WarpedTube, q: FloatArray) -> None:
    tube.has_rates = False
    for mode in range(q.shape[0]):
        tube.q[mode] = q[mode]


@kernel
def _is_strung(tube: WarpedTube, q: FloatArray) -> bool:
    is_strung = True
    for mode in range(q.shape[0]):
        is_strung = is_strung and tube.q[mode] == q[mode]
    return is_strung


@kernel
def _string_rates(tube: WarpedTube) -> None:
    """Write the derivatives of the centres by q, for the turns and centres that there are."""
    tube.has_rates = True
    turn_modes, stretch, turn, centre, rate = tube.turn_modes, tube.stretch_modes, tube.turn, tube.centre, tube.rate
    small, between = tube.small, tube.between
    R, A, middle, step, moved = small[:3], small[3:6], small[6], small[8], small[9:]
    rate[0] = 0.0
    for k in range(stretch.shape[0]):
        interpolate_turn(turn, k, 0.5, middle)
        rotation_matrix(middle, R)
        left_jacobian(middle, A)
        for i in range(3):
            step[i] = centre[k + 1, i] - centre[k, i]
            for mode in range(between.shape[1]):
                between[i, mode] = 0.5 * (turn_modes[k, i, mode] + turn_modes[k + 1, i, mode])
                rate[k + 1, i, mode] = rate[k, i, mode]
        _turn_of_arm(A, step, moved)
        _add_rotated(moved, between, rate[k + 1])
        _add_rotated(R, stretch[k], rate[k + 1])


@kernel
def node_positions(address: Address[WarpedTube], nodes: IntArray, extra: FloatArray, out: FloatArray) -> None:
    """Write the warped positions (k, 3) of ``nodes`` (k,); ``extra`` (k, 3) rides along."""
    tube = tube_at(address)
    for index in range(nodes.shape[0]):
        place_node(tube, nodes[index], extra[index], out[index])


@kernel
def place_node(tube: WarpedTube, node: int, extra: FloatArray, out: FloatArray) -> None:
    """Write the warped position (3,) of a node; ``extra`` (3,) rides along."""
    R, vector, carried, centre = tube.small[:3], tube.small[6], tube.small[7], tube.centre
    k, t = tube.segment[node], tube.fraction[node]
    interpolate_turn(tube.turn, k, t, vector)
    rotation_matrix(vector, R)
    _product(tube.local[node], tube.q, carried)
    for i in range(3):
        carried[i] += tube.arm[node, i] + extra[i]
    _rotate(R, carried, vector)
    for i in range(3):
        out[i] = (1.0 - t) * centre[k, i] + t * centre[k + 1, i] + vector[i]


@kernel
def node_rows(address: Address[WarpedTube], nodes: IntArray, extra: FloatArray, out: FloatArray) -> None:
    """Write the derivatives (k, 3, r) of the warped positions of ``nodes`` (k,) by q; ``extra`` (k, 3) rides along."""
    tube = tube_at(address)
    if not tube.has_rates:
        _string_rates(tube)
    segment, fraction, arm, local, q = tube.segment, tube.fraction, tube.arm, tube.local, tube.q
    turn, rate, turn_modes, small, between = tube.turn, tube.rate, tube.turn_modes, tube.small, tube.between
    R, A, vector, carried, moved = small[:3], small[3:6], small[6], small[7], small[9:]
    for index in range(nodes.shape[0]):
        node = nodes[index]
        k, t = segment[node], fraction[node]
        interpolate_turn(turn, k, t, vector)
        rotation_matrix(vector, R)
        left_jacobian(vector, A)
        _product(local[node], q, carried)
        for i in range(3):
            carried[i] += arm[node, i] + extra[index, i]
            for mode in range(q.shape[0]):
                between[i, mode] = (1.0 - t) * turn_modes[k, i, mode] + t * turn_modes[k + 1, i, mode]
                out[index, i, mode] = (1.0 - t) * rate[k, i, mode] + t * rate[k + 1, i, mode]
        _rotate(R, carried, vector)
        _turn_of_arm(A, vector, moved)
        _add_rotated(moved, between, out[index])
        _add_rotated(R, local[node], out[index])


@kernel
def turn_rates(tube: WarpedTube, node: int, axis: Vector) -> FloatArray:
    """Return the rotation rate of a node's section about an axis per rate of each coordinate (r,), which is scratch."""
    out: FloatArray = tube.between[0]
    A, turn = tube.small[3:6], tube.small[6]
    k, t, modes = tube.segment[node], tube.fraction[node], tube.turn_modes
    interpolate_turn(tube.turn, k, t, turn)
    left_jacobian(turn, A)
    out[:] = 0.0
    for i in range(3):
        about = axis[0] * A[0, i] + axis[1] * A[1, i] + axis[2] * A[2, i]
        for mode in range(out.shape[0]):
            out[mode] += about * ((1.0 - t) * modes[k, i, mode] + t * modes[k + 1, i, mode])
    return out


@kernel
def turn_vectors(
    address: Address[WarpedTube], nodes: IntArray, back: bool, vectors: FloatArray, out: FloatArray
) -> None:
    """Write ``vectors`` (k, 3) of nodes turned with their sections, or ``back`` from there, into ``out`` (k, 3)."""
    tube = tube_at(address)
    for k in range(nodes.shape[0]):
        turn_vector(tube, nodes[k], back, vectors[k], out[k])


@kernel
def turn_vector(tube: WarpedTube, node: int, back: bool, vector: FloatArray, out: FloatArray) -> None:
    """Do what `turn_vectors` does for a single node; vectors are (3,)."""
    Q, turn = tube.small[:3], tube.small[6]
    interpolate_turn(tube.turn, tube.segment[node], tube.fraction[node], turn)
    rotation_matrix(turn, Q)
    if back:
        _rotate_back(Q, vector, out)
    else:
        _rotate(Q, vector, out)


@kernel
def node_rotations(address: Address[WarpedTube], nodes: IntArray, out: FloatArray) -> None:
    """Write the rotations (k, 3, 3) of the sections of ``nodes`` (k,)."""
    tube = tube_at(address)
    turn = tube.small[6]
    for k in range(nodes.shape[0]):
        interpolate_turn(tube.turn, tube.segment[nodes[k]], tube.fraction[nodes[k]], turn)
        rotation_matrix(turn, out[k])
