"""Transforms an arm's reading to the pose of the tool in the world, by mount, port and roll."""

from __future__ import annotations

import math

import numpy as np

from trocar.services.gateway.servo.servo_arrays import READ_POSITION, READ_ROLL, READ_VELOCITY
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.scene.tool_orientation import tool_orientation
from trocar.services.runtime.config.rig import Mount


def pack_mount(mount: Mount) -> FloatArray:
    """Return cosine and sine of the arm's yaw and the world position of its centre, (5,)."""
    return np.array([math.cos(mount.yaw_rad), math.sin(mount.yaw_rad), *mount.centre_m])


@kernel
def place_tool(reading: FloatArray, mount: FloatArray, port: FloatArray, motion: FloatArray, pose: FloatArray) -> None:
    """Write position and velocity in the world into `motion` (6,), and the orientation wxyz into `pose` (4,).

    The arm is upright: its frame is the world's, turned by the yaw about z.
    """
    to_world(reading, READ_POSITION, mount, motion, 0)
    to_world(reading, READ_VELOCITY, mount, motion, 3)
    for axis in range(3):
        motion[axis] += mount[2 + axis]
    tool_orientation(motion, port, reading[READ_ROLL], pose)


@kernel
def to_world(vector: FloatArray, at: int, mount: FloatArray, out: FloatArray, out_at: int) -> None:
    """Rotate the three numbers of `vector` from `at` on to the axes of the world, into `out` from `out_at` on."""
    c, s = mount[0], mount[1]
    x, y = vector[at], vector[at + 1]
    out[out_at] = c * x - s * y
    out[out_at + 1] = s * x + c * y
    out[out_at + 2] = vector[at + 2]


@kernel
def to_arm(vector: FloatArray, at: int, mount: FloatArray, out: FloatArray, out_at: int) -> None:
    """Rotate the three numbers of `vector` from `at` on to the axes of the arm; the inverse of `to_world`."""
    c, s = mount[0], mount[1]
    x, y = vector[at], vector[at + 1]
    out[out_at] = c * x + s * y
    out[out_at + 1] = c * y - s * x
    out[out_at + 2] = vector[at + 2]


@kernel
def force_to_arm(force: FloatArray, mount: FloatArray, out: FloatArray) -> None:
    """Write a force in world axes into `out` (3,) in the frame of the arm."""
    to_arm(force, 0, mount, out, 0)
