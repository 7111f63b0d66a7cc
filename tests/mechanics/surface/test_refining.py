"""Finer triangles where a surface has details: the same surface, without a vertex within an edge."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.services.mechanics.surface.mesh import (
    smallest_angles_rad,
    triangle_area_vectors,
    triangle_areas_m2,
    unique_edges,
)
from trocar.services.mechanics.surface.refining import LONGEST, refine
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

TUBE = parametric_duct(DuctGeometry(4e-3, 40e-3, 24, 40))


def wanted_m(points_m: np.ndarray) -> np.ndarray:
    """Fine in the middle, growing away from it."""
    return 0.3e-3 + 0.5 * np.maximum(np.abs(points_m[:, 0] - 20e-3) - 5e-3, 0.0)


def test_edges_are_as_short_as_wanted_and_the_surface_is_the_same() -> None:
    fine = refine(TUBE, wanted_m)
    edges, counts = unique_edges(fine)
    ends = fine.vertices_m[edges]
    length_m = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert (length_m <= LONGEST * wanted_m(ends.mean(axis=1))).all()
    assert (counts == 1).sum() == 48
    assert counts.max() == 2
    normals = triangle_area_vectors(fine)
    assert (normals / triangle_areas_m2(fine)[:, None] * fine.vertices_m[fine.triangles].mean(axis=1))[:, 1:].sum(
        axis=1
    ).min() > 0.9 * 4e-3
    assert triangle_areas_m2(fine).sum() == pytest.approx(triangle_areas_m2(TUBE).sum(), rel=1e-12)
    assert fine.vertices_m[: TUBE.n_vertices] == pytest.approx(TUBE.vertices_m, abs=0.0)
    assert fine.n_vertices < 0.5 * TUBE.n_vertices * 16
    assert smallest_angles_rad(fine).min() > 0.4 * smallest_angles_rad(TUBE).min()


def test_a_surface_that_is_fine_enough_is_left_alone() -> None:
    assert refine(TUBE, lambda points_m: np.full(len(points_m), 1.0)) is TUBE
