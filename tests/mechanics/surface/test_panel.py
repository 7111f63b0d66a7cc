"""Panels by numbers: where they lie, what their edges are called, that a full turn stays slit, what is refused."""

import math

import numpy as np
import pytest

from trocar.services.mechanics.surface.mesh import triangle_area_vectors, unique_edges
from trocar.studies.published.panel import Annulus, Cylinder, Plate, Sphere

QUARTER = 0.5 * math.pi


@pytest.mark.parametrize(
    ("panel", "area_m2"),
    [
        (Plate(3.0, 2.0, 6, 4), 6.0),
        (Annulus(6.0, 10.0, 120, 8), 64.0 * math.pi),
        (Cylinder(2.0, 5.0, 60, 10, QUARTER), 5.0 * math.pi),
        (Sphere(10.0, 60, 60, QUARTER, (0.0, math.radians(72.0))), 50.0 * math.pi * math.sin(math.radians(72.0))),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_panel_has_the_area_of_its_shape_and_four_edges(panel, area_m2):
    mesh = panel.mesh()
    assert np.linalg.norm(triangle_area_vectors(mesh), axis=1).sum() == pytest.approx(area_m2, rel=1e-3)
    edges, shared = unique_edges(mesh)
    rim = np.unique(edges[shared == 1])
    sides = {name: ids for name, ids in mesh.vertex_sets.items() if "_" not in name}
    assert len(sides) == 4
    np.testing.assert_array_equal(np.unique(np.concatenate(list(sides.values()))), rim)
    assert shared.max() == 2
    for name, corner in mesh.vertex_sets.items():
        if "_" in name:
            end, side = name.split("_")
            np.testing.assert_array_equal(corner, np.intersect1d(sides[end], sides[side]))


@pytest.mark.parametrize("panel", [Cylinder(2.0, 5.0, 12, 4), Sphere(10.0, 12, 6)])
def test_normals_point_away_from_the_middle(panel):
    mesh = panel.mesh()
    middle = mesh.vertices_m[mesh.triangles].mean(axis=1)
    if isinstance(panel, Cylinder):
        middle[:, 2] = 0.0
    assert np.all(np.sum(triangle_area_vectors(mesh) * middle, axis=1) > 0.0)


def test_a_full_turn_leaves_a_slit_of_no_width():
    mesh = Annulus(6.0, 10.0, 30, 4).mesh()
    start, end = mesh.vertex_sets["start"], mesh.vertex_sets["end"]
    np.testing.assert_allclose(mesh.vertices_m[start], mesh.vertices_m[end], atol=1e-12)
    assert not np.intersect1d(start, end).size


@pytest.mark.parametrize(
    ("panel", "sentence"),
    [
        (Plate(-1.0, 2.0, 6, 4), "plate: length_m must be positive"),
        (Plate(1.0, 2.0, 0, 4), "plate: n_along must be at least 1, is 0"),
        (Annulus(6.0, 5.0, 6, 4), "annulus: outer_radius_m must be above inner_radius_m"),
        (Cylinder(2.0, math.inf, 6, 4), "cylinder: length_m must be positive"),
        (Cylinder(2.0, 5.0, 6, 4, 6.3), "cylinder: angle_rad must be above 0 and at most a full turn"),
        (Cylinder(2.0, 5.0, 60_000, 60_000), "cylinder: n_around times n_along make .* triangles, at most 2e[+]06"),
        (Sphere(1.0, 6, 4, 1.0, (0.0, 1.6)), "sphere: latitudes_rad must rise, between the poles"),
    ],
)
def test_what_is_no_panel_is_refused(panel, sentence):
    with pytest.raises(ValueError, match=sentence):
        panel.mesh()
