"""From what an arm reads to the pose of the tool in the world: mount, port, roll."""

from __future__ import annotations

import math

import numpy as np

from services.gateway.layout import READ_POSITION, READ_ROLL, READ_VELOCITY
from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.scene.tool_orientation import tool_orientation
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
def force_to_arm(force: FloatArray, mount: FloatArray, out: FloatArray) -> None:
    """Write a force of the world into the frame of the arm, `out` (3,)."""
    c, s = mount[0], mount[1]
    out[0] = c * force[0] + s * force[1]
    out[1] = c * force[1] - s * force[0]
    out[2] = force[2]
