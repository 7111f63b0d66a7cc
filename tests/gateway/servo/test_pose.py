from __future__ import annotations

import math

import numpy as np

from trocar.services.gateway.servo import pose, servo_arrays
from trocar.services.runtime.config.rig import Mount

PORT = np.array([0.06, -0.1, 0.13])


def test_the_mount_turns_and_shifts_and_forces_go_back_the_same_way() -> None:
    mount = pose.pack_mount(Mount(centre_m=(0.1, 0.2, 0.3), yaw_rad=math.pi / 2))
    reading = np.zeros(servo_arrays.READ_SIZE)
    reading[servo_arrays.READ_POSITION : servo_arrays.READ_POSITION + 3] = 0.01, 0.02, 0.03
    reading[servo_arrays.READ_VELOCITY : servo_arrays.READ_VELOCITY + 3] = 1.0, 0.0, 0.5
    motion, wxyz, force = np.zeros(6), np.zeros(4), np.zeros(3)
    pose.place_tool(reading, mount, PORT, motion, wxyz)
    np.testing.assert_allclose(motion, (0.08, 0.21, 0.33, 0.0, 1.0, 0.5), atol=1e-12)
    pose.force_to_arm(np.array([0.0, 2.0, 1.0]), mount, force)
    np.testing.assert_allclose(force, (2.0, 0.0, 1.0), atol=1e-12)
