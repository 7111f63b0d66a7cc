"""The drawn wall of a tube against closed forms."""

import numpy as np
import pytest

from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.visualization.thick_wall import ThickWall, boundary, refine

RADIUS_M, LENGTH_M, THICKNESS_M = 4e-3, 40e-3, 6e-4


def make_wall(n_around: int, *, fine: bool, thickness_m: float = THICKNESS_M):
    mesh = parametric_duct(DuctGeometry(radius_m=RADIUS_M, length_m=LENGTH_M, n_around=n_around, n_along=n_around))
    points = mesh.vertices_m.astype(np.float32)
    wall = ThickWall(points, mesh.triangles, thickness_m, fine=fine)
    out, normals = np.full((2, wall.n_points, 3), np.nan, np.float32)
    wall.update(points, out, normals)
    return wall, out, normals


def volume(points, triangles) -> float:
    a, b, c = points.astype(float)[triangles].transpose(1, 0, 2)
    return float(np.sum(np.cross(a, b) * c) / 6.0)


@pytest.mark.parametrize("fine", [False, True])
def test_the_walls_surface_is_closed_and_holds_the_tissues_volume(fine: bool) -> None:
    exact, errors = 2.0 * np.pi * RADIUS_M * THICKNESS_M * LENGTH_M, []
    for n_around in (12, 24):
        wall, points, _ = make_wall(n_around, fine=fine)
        _, place = np.unique(points.round(9), axis=0, return_inverse=True)
        assert len(boundary(place[wall.triangles])) == 0, "there is a gap between faces and rim"
        errors.append(abs(volume(points, wall.triangles) / exact - 1.0))
    assert errors[1] < 0.35 * errors[0]
    assert errors[1] < (0.004 if fine else 0.015)


def test_new_vertices_lie_closer_to_the_tube_than_the_middles_of_its_edges() -> None:
    """A cubic between two points of a circle is fourth order, the chord second."""
    worst = []
    for n_around in (12, 24):
        middle = make_wall(n_around, fine=True, thickness_m=0.0)[1]
        inner = (middle[:, 0] > 0.2 * LENGTH_M) & (middle[:, 0] < 0.8 * LENGTH_M)
        worst.append(np.abs(np.hypot(middle[inner, 1], middle[inner, 2]) / RADIUS_M - 1.0).max())
    assert worst[0] < 0.006
    assert worst[1] < worst[0] / 10.0


def test_refining_keeps_corners_and_winding() -> None:
    edges, fine = refine(np.array([[0, 1, 2], [2, 1, 3]], np.int32), 4)
    assert len(edges) == 5, "the common edge has one new vertex"
    assert len(fine) == 8
    assert {tuple(edge) for edge in edges.tolist()} == {(0, 1), (1, 2), (0, 2), (1, 3), (2, 3)}
    assert len(boundary(fine)) == 8


def test_a_fine_mid_surface_is_drawn_as_it_is() -> None:
    """Four times its triangles would show nothing more, and cost a picture drawn by a processor."""
    assert len(make_wall(24, fine=True)[0].triangles) > 8 * 24 * 24, "both faces, each triangle in four"
    fine, plain = (make_wall(40, fine=which)[0] for which in (True, False))
    assert np.array_equal(fine.triangles, plain.triangles)
