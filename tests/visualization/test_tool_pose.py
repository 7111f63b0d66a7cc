"""Tools are drawn where they collide."""

import numpy as np

from trocar.services.mechanics.bodies.forceps import tool_frame, tool_segments
from trocar.services.visualization import tool_pose
from trocar.services.visualization.drawn_bodies import pose_matrix


def test_the_jaws_that_are_drawn_lie_on_the_segments_that_collide():
    junction, port, roll, opening, length = np.array([0.03, 0.01, 0.02]), (0.08, -0.05, 0.15), 0.7, 0.4, 0.015
    frame, segments = np.empty((3, 3)), np.empty((3, 2, 3))
    tool_frame(junction, np.array(port), roll, frame)
    tool_segments(junction, np.array(port), frame, opening, length, segments)
    pose = pose_matrix(np.concatenate([junction, tool_pose.orientation(junction, port, roll)]))
    half = 0.5 * opening
    jaw_a = pose @ [length * np.cos(half), length * np.sin(half), 0.0, 1.0]
    jaw_b = pose @ [length * np.cos(half), -length * np.sin(half), 0.0, 1.0]
    np.testing.assert_allclose([jaw_a[:3], jaw_b[:3]], segments[1:, 1], atol=1e-12)


def test_a_tool_in_its_own_port_has_a_frame_all_the_same():
    pose = np.concatenate([np.zeros(3), tool_pose.orientation(np.array([1.0, 2.0, 3.0]), (1.0, 2.0, 3.0), 0.3)])
    np.testing.assert_array_equal(pose_matrix(pose), np.eye(4))
