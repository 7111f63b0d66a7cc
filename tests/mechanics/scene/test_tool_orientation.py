"""The orientation that is told and drawn is that of the tool that touches."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trocar.services.mechanics.bodies.forceps.kinematics import tool_frame
from trocar.services.mechanics.scene.tool_orientation import tool_orientation

PORT = np.array([0.06, -0.1, 0.13])


@pytest.mark.parametrize("roll_rad", [0.0, 0.7, -2.0])
@pytest.mark.parametrize("junction", [(0.03, 0.0, 0.0), (0.06, -0.1, 0.05), (0.2, 0.1, 0.1), (0.06, 0.0, 0.18)])
def test_orientation_is_the_tool_frame_of_the_mechanics(junction, roll_rad):
    wxyz, frame = np.zeros(4), np.zeros((3, 3))
    tool_orientation(np.array(junction), PORT, roll_rad, wxyz)
    tool_frame(np.array(junction), PORT, roll_rad, frame)
    b, h, d = frame
    matrix = Rotation.from_quat(wxyz, scalar_first=True).as_matrix()
    np.testing.assert_allclose(matrix, np.column_stack((d, b, h)), atol=1e-12)
    assert np.linalg.norm(wxyz) == pytest.approx(1.0)


def test_a_junction_in_the_port_keeps_the_last_orientation():
    wxyz = np.array([0.5, 0.5, 0.5, 0.5])
    tool_orientation(PORT, PORT, 0.3, wxyz)
    np.testing.assert_array_equal(wxyz, 0.5)
