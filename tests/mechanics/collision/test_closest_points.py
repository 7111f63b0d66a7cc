"""Closest points of points, segments and triangles against enumeration of faces."""

import numpy as np
import pytest
from collision_cases import distance_of_hulls

from services.mechanics.collision import primitives


def as_vectors(array):
    return [tuple(float(x) for x in row) for row in array]


@pytest.mark.parametrize("seed", range(3))
def test_point_and_triangle(seed):
    rng = np.random.default_rng(seed)
    for _ in range(100):
        corners, point = rng.normal(size=(3, 3)), 2.0 * rng.normal(size=3)
        w = primitives.closest_on_triangle(*as_vectors([point, *corners]))
        assert min(w) >= 0.0
        assert sum(w) == pytest.approx(1.0)
        assert np.linalg.norm(point - np.array(w) @ corners) == pytest.approx(distance_of_hulls(point[None], corners))


@pytest.mark.parametrize("seed", range(3))
def test_segment_and_triangle(seed):
    rng = np.random.default_rng(seed)
    met = 0
    for _ in range(60):
        corners, ends = rng.normal(size=(3, 3)), 1.5 * rng.normal(size=(2, 3))
        d2, s, w = primitives.closest_segment_triangle(*as_vectors([*ends, *corners]))
        expected = distance_of_hulls(ends, corners)
        assert np.sqrt(d2) == pytest.approx(expected, abs=1e-9)
        points = ends[0] + s * (ends[1] - ends[0]) - np.array(w) @ corners
        assert np.linalg.norm(points) == pytest.approx(expected, abs=1e-9)
        met += expected < 1e-9
    assert met > 2, "the cases must include segments that pierce their triangle"


@pytest.mark.parametrize("kind", ["skew", "parallel", "collinear", "point"])
def test_two_segments(kind):
    rng = np.random.default_rng(7)
    for _ in range(60):
        first, second = rng.normal(size=(2, 3)), rng.normal(size=(2, 3))
        if kind == "parallel":
            second[1] = second[0] + 0.7 * (first[1] - first[0])
        elif kind == "collinear":
            second = first[0] + np.array([[1.3], [2.1]]) * (first[1] - first[0])
        elif kind == "point":
            second[1] = second[0]
        s, t, d2 = primitives.closest_of_segments(*as_vectors([*first, *second]))
        assert 0.0 <= s <= 1.0
        assert 0.0 <= t <= 1.0
        assert np.sqrt(d2) == pytest.approx(distance_of_hulls(first, second), abs=1e-9)


def test_weights_name_the_feature_exactly():
    corners = [(0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.7, 0.0)]
    assert primitives.closest_on_triangle((-1.0, -1.0, 2.0), *corners) == (1.0, 0.0, 0.0)
    assert primitives.closest_on_triangle((0.1, -1.0, 2.0), *corners)[2] == 0.0
    assert min(primitives.closest_on_triangle((0.1, 0.1, 2.0), *corners)) > 0.0
