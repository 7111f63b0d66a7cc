"""Kinematics of a forceps that turns about a fixed port: pose, jaw segments and the lever of a contact.

The frame of a tool is (b, h, d): d along the shaft from the port to the junction J, b the direction in which
jaw A opens, h = d x b the hinge. Roll is measured from the frame carried from "straight down" to d by the
smallest rotation, which is smooth for every shaft that does not point straight up.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.collision.pairs import JAW_A, JAW_B, SHAFT
from trocar.services.mechanics.compiled import inlined_kernel

N_SEGMENTS = 3
N_COORDINATES = 4  # J and the opening angle
N_CELLS = 20  # cells along the jaws, each with something between them or nothing


@inlined_kernel
def tool_frame(junction: FloatArray, port: FloatArray, roll: float, out: FloatArray) -> float:
    """Write b, h and d into the rows of ``out`` (3, 3) and return the length of shaft inside the port, in m."""
    length = math.sqrt((junction[0] - port[0]) ** 2 + (junction[1] - port[1]) ** 2 + (junction[2] - port[2]) ** 2)
    for axis in range(3):
        out[2, axis] = (junction[axis] - port[axis]) / length
    x, y, z = out[2, 0], out[2, 1], out[2, 2]
    # Smallest rotation from (0, 0, -1) to d, applied to the x and y axes.
    k = 1.0 / max(1.0 - z, 1e-9)
    cosine, sine = math.cos(roll), math.sin(roll)
    e_1 = (1.0 - k * x * x, -k * x * y, x)
    e_2 = (-k * x * y, 1.0 - k * y * y, y)
    for axis in range(3):
        out[0, axis] = cosine * e_1[axis] + sine * e_2[axis]
    out[1, 0] = out[2, 1] * out[0, 2] - out[2, 2] * out[0, 1]
    out[1, 1] = out[2, 2] * out[0, 0] - out[2, 0] * out[0, 2]
    out[1, 2] = out[2, 0] * out[0, 1] - out[2, 1] * out[0, 0]
    return length


@inlined_kernel
def tool_segments(
    junction: FloatArray, start: FloatArray, frame: FloatArray, jaw_angle: float, jaw_length: float, out: FloatArray
) -> None:
    """Write start and end of shaft, jaw A and jaw B into ``out`` (3, 2, 3), in m; the shaft begins at ``start``."""
    cosine, sine = jaw_length * math.cos(0.5 * jaw_angle), jaw_length * math.sin(0.5 * jaw_angle)
    for axis in range(3):
        out[SHAFT, 0, axis] = start[axis]
        out[SHAFT, 1, axis] = junction[axis]
        out[JAW_A, 0, axis] = junction[axis]
        out[JAW_B, 0, axis] = junction[axis]
        out[JAW_A, 1, axis] = junction[axis] + cosine * frame[2, axis] + sine * frame[0, axis]
        out[JAW_B, 1, axis] = junction[axis] + cosine * frame[2, axis] - sine * frame[0, axis]


@inlined_kernel
def contact_lever(frame: FloatArray, length: float, segment: int, arm: FloatArray, out: FloatArray) -> None:
    r"""Write the lever G (3, 4) of a point at ``arm`` = p - J: its motion is G (dJ, dtheta).

    The port only lets the shaft turn about it and slide through it, so a point moves by
    :math:`dJ + \omega \times (p - J)` with :math:`\omega = (d \times dJ) / L + d\,\sigma`, and a point of a jaw also
    by half the change of the opening. :math:`\sigma = dJ \cdot (d \times a) / (L (1 + a \cdot d))`, a straight down, is
    the spin of the frame that carries the roll when the shaft swings about the port.
    A force f on the point loads the hand at J with G^T f; the rest of it is carried by the port.
    """
    d_x, d_y, d_z = frame[2, 0], frame[2, 1], frame[2, 2]
    r_d = arm[0] * d_x + arm[1] * d_y + arm[2] * d_z
    spin = (-d_y, d_x, 0.0)
    spin_scale = 1.0 / (max(1.0 - d_z, 1e-9) * length)
    d_cross_r = (
        d_y * arm[2] - d_z * arm[1],
        d_z * arm[0] - d_x * arm[2],
        d_x * arm[1] - d_y * arm[0],
    )
    for column in range(3):
        for row in range(3):
            # (d x e) x r = e (d . r) - d (e . r)
            value = -frame[2, row] * arm[column] / length + d_cross_r[row] * spin[column] * spin_scale
            if row == column:
                value += 1.0 + r_d / length
            out[row, column] = value
    half = 0.0
    if segment == JAW_A:
        half = 0.5
    elif segment == JAW_B:
        half = -0.5
    out[0, 3] = half * (frame[1, 1] * arm[2] - frame[1, 2] * arm[1])
    out[1, 3] = half * (frame[1, 2] * arm[0] - frame[1, 0] * arm[2])
    out[2, 3] = half * (frame[1, 0] * arm[1] - frame[1, 1] * arm[0])


def jaw_angle_from_handle(handle_angle_rad: float, ratio: float, max_angle_rad: float) -> float:
    """Return the opening commanded by a handle angle, between shut and ``max_angle_rad``."""
    return min(max(ratio * handle_angle_rad, 0.0), max_angle_rad)
