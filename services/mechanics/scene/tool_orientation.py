"""Orientation of a forceps from its junction, its port and its roll."""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel


@kernel
def tool_orientation(junction: FloatArray, port: FloatArray, roll: float, pose: FloatArray) -> None:
    """Write the unit quaternion wxyz (4,) of a tool whose x axis d runs from the port (3,) to the junction (3,).

    Roll 0 is the frame carried from "straight down" to d by the smallest rotation; the y axis is the one in which
    jaw A opens. A junction in the port itself keeps the last orientation.
    """
    x, y, z = junction[0] - port[0], junction[1] - port[1], junction[2] - port[2]
    length = math.sqrt(x * x + y * y + z * z)
    if length < 1e-6:
        return
    # Smallest rotation (w, a, b, 0) from (0, 0, -1) to d: its axis (0, 0, -1) x d is (y, -x, 0) / length.
    w = math.sqrt(max(0.5 * (1.0 - z / length), 1e-12))
    a, b = 0.5 * y / (length * w), -0.5 * x / (length * w)
    # A tool that points straight down: x down, y along the world's x, z along the world's -y.
    down = (0.5, 0.5, 0.5, -0.5)
    p = (
        w * down[0] - a * down[1] - b * down[2],
        w * down[1] + a * down[0] + b * down[3],
        w * down[2] - a * down[3] + b * down[0],
        w * down[3] + a * down[2] - b * down[1],
    )
    # Roll counts from the world's x to its y where the tool points down: against the tool's own x axis.
    e, f = math.cos(0.5 * roll), -math.sin(0.5 * roll)
    pose[0] = p[0] * e - p[1] * f
    pose[1] = p[0] * f + p[1] * e
    pose[2] = p[2] * e + p[3] * f
    pose[3] = p[3] * e - p[2] * f
