"""Tool frames: along the shaft, opening as physics opens them, and quaternions that mean the same rotation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.mechanics.bodies.forceps import tool_frame, tool_segments
from services.visualization import tool_pose
from services.visualization.render import pose_matrix

numbers = st.floats(-1.0, 1.0, allow_nan=False)


@given(st.tuples(numbers, numbers, numbers), st.floats(-7.0, 7.0))
def test_the_quaternion_turns_as_the_axes_do(axis, angle):
    length = np.linalg.norm(axis)
    if length < 1e-3:
        return
    x, y, z = np.array(axis) / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross  # Rodrigues
    q = tool_pose.quaternion(rotation)
    assert np.linalg.norm(q) == pytest.approx(1.0)
    np.testing.assert_allclose(pose_matrix(np.concatenate([np.zeros(3), q]))[:3, :3], rotation, atol=1e-12)


@pytest.mark.parametrize("turn", [np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.diag([-1.0, -1, 1]), np.eye(3)])
def test_half_turns_lose_nothing(turn):
    q = tool_pose.quaternion(turn)
    np.testing.assert_allclose(pose_matrix(np.concatenate([np.zeros(3), q]))[:3, :3], turn, atol=1e-15)


def test_the_jaws_that_are_drawn_lie_on_the_segments_that_collide():
    junction, port, roll, opening, length = np.array([0.03, 0.01, 0.02]), (0.08, -0.05, 0.15), 0.7, 0.4, 0.015
    frame, segments = np.empty((3, 3)), np.empty((3, 2, 3))
    tool_frame(junction, np.array(port), roll, frame)
    tool_segments(junction, np.array(port), frame, opening, length, segments)
    axes = tool_pose.tool_axes(junction, port, roll)
    half = 0.5 * opening
    jaw_a = junction + axes @ (length * np.array([np.cos(half), np.sin(half), 0.0]))
    jaw_b = junction + axes @ (length * np.array([np.cos(half), -np.sin(half), 0.0]))
    np.testing.assert_allclose([jaw_a, jaw_b], segments[1:, 1], atol=1e-15)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)


def test_a_tool_in_its_own_port_has_a_frame_all_the_same():
    np.testing.assert_array_equal(tool_pose.tool_axes(np.array([1.0, 2.0, 3.0]), (1.0, 2.0, 3.0), 0.3), np.eye(3))
