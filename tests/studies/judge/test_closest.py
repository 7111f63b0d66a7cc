"""The brute-force distances of the judge, against the IPC Toolkit's and against sampled points."""

from __future__ import annotations

import ipctk
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from trocar.studies.judge.closest import (
    count_layers,
    nearest_triangles,
    point_triangle,
    segment_segment,
    segment_triangle,
)

NUMBERS = st.floats(-1.0, 1.0, allow_subnormal=False).map(lambda x: round(x, 3))
POINTS = arrays(np.float64, (5, 3), elements=NUMBERS)
CLOSE = 1e-9


@settings(deadline=None, max_examples=200)
@given(POINTS)
def test_a_point_is_as_far_from_a_triangle_as_the_toolkit_says(points: np.ndarray) -> None:
    p, a, b, c, _ = points
    if np.linalg.norm(np.cross(b - a, c - a)) < 1e-3:  # the toolkit knows no triangle that is a line
        return
    ours = point_triangle(tuple(p), tuple(a), tuple(b), tuple(c))
    assert abs(ours - ipctk.point_triangle_distance(p, a, b, c)) < CLOSE


@settings(deadline=None, max_examples=200)
@given(POINTS)
def test_two_segments_are_as_far_apart_as_the_toolkit_says(points: np.ndarray) -> None:
    p, q, r, s, _ = points
    if np.linalg.norm(np.cross(q - p, s - r)) < 1e-3:
        return
    ours = segment_segment(tuple(p), tuple(q), tuple(r), tuple(s))[0]
    assert abs(ours - ipctk.edge_edge_distance(p, q, r, s)) < CLOSE


@settings(deadline=None, max_examples=100)
@given(POINTS)
def test_no_sampled_point_of_a_segment_is_nearer_to_a_triangle(points: np.ndarray) -> None:
    p, q, a, b, c = points
    square, where = segment_triangle(tuple(p), tuple(q), tuple(a), tuple(b), tuple(c))
    corners = tuple(a), tuple(b), tuple(c)
    assert abs(point_triangle(tuple(p + where * (q - p)), *corners) - square) < CLOSE
    for at in np.linspace(0.0, 1.0, 41):
        assert point_triangle(tuple(p + at * (q - p)), *corners) > square - CLOSE


def test_many_triangles_are_searched_as_each_alone() -> None:
    random = np.random.default_rng(3)
    vertices, triangles = random.uniform(-1, 1, (60, 3)), random.integers(0, 60, (80, 3)).astype(np.int32)
    ends = random.uniform(-1, 1, (12, 2, 3))
    near = np.empty((12, 3))
    nearest_triangles(ends, np.full(12, 10.0), vertices, triangles, near)
    for k, (p, q) in enumerate(ends):
        alone = [segment_triangle(tuple(p), tuple(q), *map(tuple, vertices[t]))[0] for t in triangles]
        assert abs(near[k, 0] - np.sqrt(min(alone))) < 1e-12


def test_layers_between_two_points_are_counted() -> None:
    sheet = np.array([(-9.0, -9.0, 0.0), (9.0, -9.0, 0.0), (0.0, 9.0, 0.0)])
    vertices = np.concatenate([sheet, sheet + np.array([0.0, 0.0, 1.0])])
    triangles = np.array([[0, 1, 2], [3, 4, 5]], np.int32)
    low, high = np.array([0.1, 0.1, -1.0]), np.array([0.1, 0.1, 2.0])
    assert count_layers(low, high, vertices, triangles) == 2
    assert count_layers(low, np.array([0.1, 0.1, 0.5]), vertices, triangles) == 1
    assert count_layers(high, high + 1.0, vertices, triangles) == 0
