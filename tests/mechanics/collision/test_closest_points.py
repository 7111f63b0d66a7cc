"""Closest points of points, segments and triangles against enumeration of faces."""

import numpy as np
import pytest
from collision_cases import distance_of_hulls
from hypothesis import assume, event, given
from hypothesis import strategies as st

from trocar.services.mechanics.collision import primitives


def as_vectors(array):
    return [tuple(float(x) for x in row) for row in array]


#: On a grid, so that what is parallel, collinear, coincident or pierced is met often and not almost never.
coordinates = st.integers(-8, 8).map(lambda n: n / 4.0)
points = st.tuples(coordinates, coordinates, coordinates)


def places(n):
    return st.tuples(*[points] * n).map(np.array)


@given(corners=places(3), point=places(1))
def test_point_and_triangle(corners, point):
    assume(np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) > 0.0)
    w = primitives.closest_on_triangle(*as_vectors([point[0], *corners]))
    assert min(w) >= 0.0
    assert sum(w) == pytest.approx(1.0)
    assert np.linalg.norm(point - np.array(w) @ corners) == pytest.approx(distance_of_hulls(point, corners), abs=1e-9)


@given(corners=places(3), ends=places(2))
def test_segment_and_triangle(corners, ends):
    assume(np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) > 0.0)
    (p, q), triangle = as_vectors(ends), tuple(as_vectors(corners))
    d2, s, w = primitives.closest_segment_triangle(p, q, triangle, primitives.closest_places(p, q, *triangle))
    expected = distance_of_hulls(ends, corners)
    event("pierced" if expected < 1e-9 else "apart")
    assert np.sqrt(d2) == pytest.approx(expected, abs=1e-9)
    assert np.linalg.norm(ends[0] + s * (ends[1] - ends[0]) - np.array(w) @ corners) == pytest.approx(
        expected, abs=1e-9
    )


@given(first=places(2), second=places(2))
def test_two_segments(first, second):
    s, t, d2 = primitives.closest_of_segments(*as_vectors([*first, *second]))
    assert 0.0 <= s <= 1.0
    assert 0.0 <= t <= 1.0
    assert np.sqrt(d2) == pytest.approx(distance_of_hulls(first, second), abs=1e-9)


def test_weights_name_the_feature_exactly():
    corners = [(0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.7, 0.0)]
    assert primitives.closest_on_triangle((-1.0, -1.0, 2.0), *corners) == (1.0, 0.0, 0.0)
    assert primitives.closest_on_triangle((0.1, -1.0, 2.0), *corners)[2] == 0.0
    assert min(primitives.closest_on_triangle((0.1, 0.1, 2.0), *corners)) > 0.0
