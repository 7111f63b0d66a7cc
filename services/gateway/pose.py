"""From what an arm reads to the pose of the tool in the world: mount, port, roll."""

from __future__ import annotations

import math

import numpy as np

from services.gateway.layout import READ_POSITION, READ_ROLL, READ_VELOCITY
from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.runtime.rig import Mount


def pack_mount(mount: Mount) -> FloatArray:
    """Return cosine and sine of the arm's yaw and the world position of its centre, (5,)."""
    return np.array([math.cos(mount.yaw_rad), math.sin(mount.yaw_rad), *mount.centre_m])


@kernel
def place_tool(reading: FloatArray, mount: FloatArray, port: FloatArray, motion: FloatArray, pose: FloatArray) -> None:
    """Write position and velocity in the world into `motion` (6,), the orientation wxyz into `pose` (4,).

    The arm stands upright: its frame is the world's, turned by the yaw about z.
    """
    c, s = mount[0], mount[1]
    for at, read, shift in ((0, READ_POSITION, 1.0), (3, READ_VELOCITY, 0.0)):
        x, y = reading[read], reading[read + 1]
        motion[at] = c * x - s * y + shift * mount[2]
        motion[at + 1] = s * x + c * y + shift * mount[3]
        motion[at + 2] = reading[read + 2] + shift * mount[4]
    tool_orientation(motion, port, reading[READ_ROLL], pose)


@kernel
def tool_orientation(junction: FloatArray, port: FloatArray, roll: float, pose: FloatArray) -> None:
    """Write the quaternion wxyz of a tool whose x axis d runs from the port to the junction.

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


@kernel
def force_to_arm(force: FloatArray, mount: FloatArray, out: FloatArray) -> None:
    """Write a force of the world into the frame of the arm, `out` (3,)."""
    c, s = mount[0], mount[1]
    out[0] = c * force[0] + s * force[1]
    out[1] = c * force[1] - s * force[0]
    out[2] = force[2]
