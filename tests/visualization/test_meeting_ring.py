"""The ring where a tool would meet the wall, against the closed form for a tube."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.visualization.meeting_ring import first_met_m

RADIUS_M = 4e-3


def _corners_m(n_around: int) -> np.ndarray:
    mesh = parametric_duct(DuctGeometry(radius_m=RADIUS_M, length_m=40e-3, n_around=n_around, n_along=40))
    return mesh.vertices_m[mesh.triangles].astype(np.float32)


def test_rays_meet_a_tube_where_the_circle_says_and_more_so_the_finer_it_is() -> None:
    """Of second order in the angle between two corners, as a chord's distance from its arc is."""
    y = np.linspace(-0.9, 0.9, 37) * RADIUS_M
    origins_m = np.stack([np.full_like(y, 0.0213), y, np.full_like(y, 0.03)], axis=1)
    down = np.array([0.0, 0.0, -1.0])
    true_m = 0.03 - np.sqrt(RADIUS_M**2 - y**2)
    errors = [np.abs(first_met_m(_corners_m(n), origins_m, down) - true_m).max() for n in (24, 48, 96)]
    assert errors[0] < 0.15e-3
    assert errors[0] / errors[1] > 3.0
    assert errors[1] / errors[2] > 3.0


def test_from_inside_the_wall_is_met_too_and_beside_it_or_behind_nothing_is() -> None:
    corners_m, down = _corners_m(48), np.array([0.0, 0.0, -1.0])
    origins_m = np.array([[0.02, 0.0, 0.0], [0.02, 5e-3, 0.03], [0.02, 0.0, -0.03], [0.02, 0.0, 0.03]])
    met_m = first_met_m(corners_m, origins_m, down)
    assert met_m[0] == pytest.approx(RADIUS_M, rel=5e-3)
    assert np.isinf(met_m[1:3]).all()
    assert met_m[3] == pytest.approx(0.03 - RADIUS_M, rel=1e-3)
    assert np.isinf(first_met_m(corners_m[:0], origins_m, down)).all()
