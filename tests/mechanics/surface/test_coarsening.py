"""The same surface on fewer of its own vertices."""

import numpy as np
import pytest

from trocar.services.mechanics.surface.coarsening import coarsened
from trocar.services.mechanics.surface.mesh import (
    TriangleMesh,
    boundary_loops,
    smallest_angles_rad,
    triangle_areas_m2,
    unique_edges,
    vertex_normals,
)
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct


@pytest.mark.parametrize(("n_around", "n_along"), [(56, 56), (40, 90), (30, 31)])
@pytest.mark.parametrize("n", [150, 320])
@pytest.mark.parametrize("shape", [{}, {"curvature_1_m": 20.0, "taper": 0.7}, {"cut_angle_rad": 0.5}])
def test_a_duct_stays_a_duct(n_around, n_along, n, shape):
    mesh = parametric_duct(DuctGeometry(radius_m=4e-3, length_m=40e-3, n_around=n_around, n_along=n_along, **shape))
    coarse, kept = coarsened(mesh, n)
    assert coarse.n_vertices == pytest.approx(n, rel=0.26)
    assert np.array_equal(coarse.vertices_m, mesh.vertices_m[kept])
    assert len(boundary_loops(coarse)) == 2
    assert coarse.n_vertices - len(unique_edges(coarse)[0]) + coarse.n_triangles == 0
    assert triangle_areas_m2(coarse).sum() == pytest.approx(triangle_areas_m2(mesh).sum(), rel=0.05)
    assert np.degrees(smallest_angles_rad(coarse)).min() > 3.0
    # As wound as before: normals point where they did.
    assert np.all(np.sum(vertex_normals(coarse) * vertex_normals(mesh)[kept], axis=1) > 0.5)
    for name, ids in mesh.vertex_sets.items():
        assert set(kept[coarse.vertex_sets[name]]) == set(kept) & set(ids)
        assert len(coarse.vertex_sets[name]) >= 6


@pytest.mark.parametrize("turn_rad", np.linspace(0.0, 6.0, 7))
@pytest.mark.parametrize("n", [150, 600])
def test_a_rim_may_have_long_edges_and_short_ones(turn_rad, n):
    """Wherever it begins: its last edge may be longer than what lies between two seeds."""
    even = parametric_duct(DuctGeometry(radius_m=4e-3, length_m=40e-3, n_around=24, n_along=40))
    x, y, z = even.vertices_m.T
    angle = np.arctan2(z, y)
    angle += 0.8 * np.sin(angle - turn_rad)
    round_it = np.hypot(y, z)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    mesh = TriangleMesh(np.column_stack([x, round_it]), even.triangles, even.vertex_sets)
    coarse, kept = coarsened(mesh, n)
    assert coarse.n_vertices == pytest.approx(n, rel=0.26)
    for rim in boundary_loops(mesh):
        assert len(set(kept) & set(rim.tolist())) >= 6


def test_a_surface_that_so_few_vertices_cannot_make_is_refused():
    corners = np.concatenate([np.eye(3), -np.eye(3)])
    octahedron = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    with pytest.raises(ValueError, match="no surface of about 3 of its vertices has the same rims"):
        coarsened(TriangleMesh(corners, np.array(octahedron)), 3)
