"""Caps close a surface with the least area."""

import numpy as np
import pytest

from trocar.services.mechanics.surface.mesh import boundary_loops
from trocar.services.mechanics.surface.rim_caps import fill_rim
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

RADIUS_M = 4e-3


def test_a_cap_of_least_area_closes_a_rim():
    mesh = parametric_duct(DuctGeometry(radius_m=RADIUS_M, length_m=40e-3, n_around=36, n_along=30))
    rim = mesh.vertex_sets["mouth"]
    a, b, c = (mesh.vertices_m[fill_rim(mesh.vertices_m, rim)[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    assert area == pytest.approx(0.5 * 36 * np.sin(2.0 * np.pi / 36) * RADIUS_M**2)
    edges = np.concatenate([mesh.triangles, *(fill_rim(mesh.vertices_m, loop) for loop in boundary_loops(mesh))])
    directed = edges[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert len({tuple(e) for e in directed}) == len(directed)
    assert {tuple(e) for e in directed} == {tuple(e[::-1]) for e in directed}
