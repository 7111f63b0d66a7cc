from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.gateway import layout, pose
from services.mechanics.bodies.forceps.kinematics import tool_frame
from services.runtime.rig import Mount

PORT = np.array([0.06, -0.1, 0.13])


@pytest.mark.parametrize("roll_rad", [0.0, 0.7, -2.0])
@pytest.mark.parametrize("junction", [(0.03, 0.0, 0.0), (0.06, -0.1, 0.05), (0.2, 0.1, 0.1), (0.06, 0.0, 0.18)])
def test_orientation_is_the_tool_frame_of_the_mechanics(junction: tuple[float, ...], roll_rad: float) -> None:
    wxyz, frame = np.zeros(4), np.zeros((3, 3))
    pose.tool_orientation(np.array(junction), PORT, roll_rad, wxyz)
    tool_frame(np.array(junction), PORT, roll_rad, frame)
    b, h, d = frame
    matrix = Rotation.from_quat(wxyz, scalar_first=True).as_matrix()
    np.testing.assert_allclose(matrix, np.column_stack((d, b, h)), atol=1e-12)
    assert np.linalg.norm(wxyz) == pytest.approx(1.0)


def test_a_junction_in_the_port_keeps_the_last_orientation() -> None:
    wxyz = np.array([0.5, 0.5, 0.5, 0.5])
    pose.tool_orientation(PORT, PORT, 0.3, wxyz)
    np.testing.assert_array_equal(wxyz, 0.5)


def test_the_mount_turns_and_shifts_and_forces_go_back_the_same_way() -> None:
    mount = pose.pack_mount(Mount(centre_m=(0.1, 0.2, 0.3), yaw_rad=math.pi / 2))
    reading = np.zeros(layout.READ_SIZE)
    reading[layout.READ_POSITION : layout.READ_POSITION + 3] = 0.01, 0.02, 0.03
    reading[layout.READ_VELOCITY : layout.READ_VELOCITY + 3] = 1.0, 0.0, 0.5
    motion, wxyz, force = np.zeros(6), np.zeros(4), np.zeros(3)
    pose.place_tool(reading, mount, PORT, motion, wxyz)
    np.testing.assert_allclose(motion, (0.08, 0.21, 0.33, 0.0, 1.0, 0.5), atol=1e-12)
    pose.force_to_arm(np.array([0.0, 2.0, 1.0]), mount, force)
    np.testing.assert_allclose(force, (2.0, 0.0, 1.0), atol=1e-12)
