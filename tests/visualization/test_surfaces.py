"""Normals and the swept tube against closed forms."""

import numpy as np
import pytest

from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.visualization.normals import vertex_normals
from trocar.services.visualization.tube import sweep_tube, tube_triangles


def _tube(n_around: int):
    mesh = parametric_duct(DuctGeometry(radius_m=4e-3, length_m=40e-3, n_around=n_around, n_along=10))
    return mesh.vertices_m.astype(np.float32), mesh.triangles


def _error(points, triangles, exact):
    normals = np.empty_like(points)
    vertex_normals(points, triangles, normals)
    inner = slice(len(points) // 3, 2 * len(points) // 3)  # rims see triangles on one side only
    return np.linalg.norm(normals[inner] - exact[inner], axis=1).max()


def _unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_normals_of_a_bent_tube_converge_with_the_mesh():
    errors, bend_m = [], 30e-3
    for n in (1, 2, 4):
        geometry = DuctGeometry(
            radius_m=4e-3, length_m=40e-3, n_around=10 * n, n_along=9 * n, curvature_1_m=1.0 / bend_m
        )
        mesh = parametric_duct(geometry)
        centre = np.array([0.0, bend_m, 0.0])
        axis = centre + bend_m * _unit((mesh.vertices_m - centre) * [1.0, 1.0, 0.0])
        errors.append(_error(mesh.vertices_m.astype(np.float32), mesh.triangles, _unit(mesh.vertices_m - axis)))
    rates = np.log2(np.divide(errors[:-1], errors[1:]))
    assert errors[-1] < 0.02
    assert rates.min() > 0.9


def test_normals_follow_a_deformation():
    """The regression that VTK's own filter has: normals of a mesh that was changed in place stayed the old ones."""
    points, triangles = _tube(48)
    shear = points.copy()
    shear[:, 2] += 0.8 * points[:, 0]
    # The normal of {y^2 + (z - 0.8 x)^2 = r^2} is the gradient of what defines it.
    gradient = np.stack([-0.8 * points[:, 2], points[:, 1], points[:, 2]], axis=1)
    assert _error(shear, triangles, _unit(gradient)) < 0.02
    assert _error(shear, triangles, _unit(points * [0.0, 1.0, 1.0])) > 0.1


def test_a_vertex_without_triangles_has_no_normal():
    points = np.eye(4, 3, dtype=np.float32)
    normals = np.full((4, 3), np.nan, np.float32)
    vertex_normals(points, np.array([[0, 1, 2]], np.int32), normals)
    np.testing.assert_allclose(normals[:3], 1.0 / np.sqrt(3.0), rtol=1e-6)
    np.testing.assert_array_equal(normals[3], 0.0)


@pytest.fixture
def helix():
    s = np.linspace(0.0, 4.0 * np.pi, 120)
    return np.stack([np.cos(s), np.sin(s), 0.3 * s], axis=1).astype(np.float32)


def test_a_swept_tube_keeps_its_radius_and_stands_square_on_its_line(helix):
    sides, radius = 16, 0.05
    points, normals = np.empty((2, len(helix) * sides, 3), np.float32)
    sweep_tube(helix, np.full(len(helix), radius, np.float32), points, normals)
    arms = points.reshape(-1, sides, 3) - helix[:, None]
    np.testing.assert_allclose(np.linalg.norm(arms, axis=2), radius, rtol=1e-4)
    tangent = np.gradient(helix, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    assert np.abs(np.einsum("nsk,nk->ns", arms / radius, tangent)).max() < 1e-3


def test_a_swept_tube_does_not_turn_about_a_plane_line():
    angle = np.linspace(0.0, np.pi, 60)
    arc = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1).astype(np.float32)
    points, normals = np.empty((2, 60 * 8, 3), np.float32)
    sweep_tube(arc, np.full(60, 0.1, np.float32), points, normals)
    height = normals.reshape(60, 8, 3)[:, :, 2]
    np.testing.assert_allclose(height, np.broadcast_to(height[0], height.shape), atol=1e-5)


def test_the_tubes_triangles_face_outwards(helix):
    sides = 10
    points, normals = np.empty((2, len(helix) * sides, 3), np.float32)
    sweep_tube(helix, np.full(len(helix), 0.05, np.float32), points, normals)
    again = np.empty_like(normals)
    vertex_normals(points, tube_triangles(len(helix), sides), again)
    assert np.einsum("nk,nk->n", again, normals)[sides:-sides].min() > 0.95
