"""Topology read off triangle meshes."""

import numpy as np
import pytest

from trocar.services.mechanics.surface.mesh import (
    TriangleMesh,
    boundary_loops,
    triangle_areas_m2,
    unique_edges,
    vertex_adjacency,
    vertex_areas_m2,
    vertex_components,
    vertex_normals,
)
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

TUBE = parametric_duct(DuctGeometry(4e-3, 40e-3, 16, 12))
SQUARE = TriangleMesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))


def test_euler_characteristic_of_a_tube_is_zero():
    edges, shared = unique_edges(TUBE)
    assert TUBE.n_vertices - len(edges) + TUBE.n_triangles == 0
    assert np.bincount(shared)[1] == 2 * 16


def test_boundary_loop_follows_the_edges_of_its_triangles():
    (rim,) = boundary_loops(SQUARE)
    start = int(np.flatnonzero(rim == 0)[0])
    assert np.roll(rim, -start).tolist() == [0, 1, 2, 3]


def test_boundary_loops_are_the_two_rims():
    rims = {frozenset(rim.tolist()) for rim in boundary_loops(TUBE)}
    assert rims == {frozenset(TUBE.vertex_sets[name].tolist()) for name in ("clamped", "mouth")}


def test_a_branching_rim_is_refused_with_its_vertex():
    bow_tie = TriangleMesh(
        np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]), np.array([[0, 1, 2], [0, 3, 4]])
    )
    with pytest.raises(ValueError, match="rims meet at vertex 0"):
        boundary_loops(bow_tie)


def test_areas_and_normals():
    assert vertex_areas_m2(TUBE).sum() == pytest.approx(triangle_areas_m2(TUBE).sum(), rel=1e-13)
    radial = TUBE.vertices_m * [0, 1, 1] / 4e-3
    assert np.sum(vertex_normals(TUBE) * radial, axis=1) == pytest.approx(np.ones(TUBE.n_vertices), abs=0.03)


def test_components_and_adjacency():
    two = TriangleMesh(
        np.concatenate([SQUARE.vertices_m, SQUARE.vertices_m + 5.0]),
        np.concatenate([SQUARE.triangles, SQUARE.triangles + 4]),
    )
    assert len(set(vertex_components(two).tolist())) == 2
    neighbours = vertex_adjacency(two)[[0]].indices
    assert sorted(neighbours.tolist()) == [1, 2, 3]


@pytest.mark.parametrize(
    ("vertices", "triangles", "sets", "message"),
    [
        (np.zeros((3, 2)), np.array([[0, 1, 2]]), {}, "expected \\(n, 3\\)"),
        (np.zeros((3, 3)), np.array([[0, 1, 3]]), {}, "names vertex 3, there are 3"),
        (np.array([[0, 0, 0], [1, 0, np.nan], [0, 1, 0]]), np.array([[0, 1, 2]]), {}, "vertex 1 is not finite"),
        (np.eye(3), np.array([[0, 1, 2]]), {"rim": np.array([7])}, "vertex set 'rim'"),
        (np.eye(3), np.zeros((0, 3), int), {}, "expected \\(m, 3\\)"),
    ],
)
def test_malformed_meshes_are_refused(vertices, triangles, sets, message):
    with pytest.raises(ValueError, match=message):
        TriangleMesh(vertices, triangles, sets)
