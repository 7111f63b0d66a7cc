"""Crossings are counted from positions alone."""

import numpy as np

from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.studies.stability.crossings import count_crossings

TUBE = parametric_duct(DuctGeometry(4e-3, 40e-3, 12, 14))


def crossings(*points_mm):
    return count_crossings(1e-3 * np.array(points_mm, dtype=float), TUBE.vertices_m, TUBE.triangles)


def test_a_line_along_the_lumen_and_one_outside_cross_nothing():
    assert crossings((-10, 0, 0), (10, 0.5, 0), (30, 0, 1), (60, 0, 0)) == 0
    assert crossings((-10, 6, 0), (60, 6, 0)) == 0


def test_every_segment_that_pierces_the_wall_counts_once():
    assert crossings((20, 0.1, 0.2), (20, 10, 0.3)) == 1
    assert crossings((20, -10, 0.3), (20, 10, 0.3)) == 1
    assert crossings((60, 0, 0), (30, 0, 0.1), (25, 0.2, 8), (20, 0.3, 0), (10, 0, 0)) == 2


def test_a_segment_that_ends_short_of_the_wall_does_not():
    assert crossings((20, 0.1, 0.2), (20, 3.5, 0.3)) == 0
    assert crossings((20, 0.1, 0.2), (20, 4.1, 0.3)) == 1
