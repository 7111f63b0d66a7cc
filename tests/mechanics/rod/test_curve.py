"""The smooth curve of a rod, and what its introducer holds by it."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from trocar.services.mechanics.rod.curve import closest_on_curve, point_on_curve


def zigzag(random, n):
    """Particles 2 mm apart with turns of up to a radian."""
    directions = np.cumsum(random.normal(scale=0.3, size=(n - 1, 3)), axis=0) + np.array((3.0, 0.0, 0.0))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return 2e-3 * np.concatenate([np.zeros((1, 3)), np.cumsum(directions, axis=0)])


def spline(x):
    """Points all along the quadratic B-spline of scipy between the middles of the first and the last segment."""
    n = len(x)
    curve = BSpline(np.arange(-1.0, n + 2.0) - 0.5, x, 2)
    return curve(np.linspace(0.5, n - 1.5, 200_001))


@pytest.mark.parametrize("seed", range(5))
def test_the_nearest_point_is_that_of_a_quadratic_spline(seed):
    random = np.random.default_rng(seed)
    x = zigzag(random, 12)
    points = spline(x)
    for segment in range(2, 9):
        p = points[np.argmin(np.linalg.norm(points - x[segment : segment + 2].mean(axis=0), axis=1))]
        p = p + 1e-4 * random.normal(size=3)
        found = closest_on_curve(x, segment, 0.5, tuple(p))
        at = np.array(found.weights) @ x[found.first : found.first + 3]
        assert np.linalg.norm(at - p) == pytest.approx(np.linalg.norm(points - p, axis=1).min(), rel=1e-6)
        assert at - p == pytest.approx(np.array(found.offset), abs=1e-12)
        assert np.dot(found.offset, found.direction) == pytest.approx(0.0, abs=1e-18)
        assert sum(found.weights) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("at", [0.3, 1.5, 4.2, 9.9, 10.8])
def test_a_place_along_the_curve_is_on_it_and_its_slope_is_the_derivative(at):
    x = zigzag(np.random.default_rng(1), 12)

    def curve_m(where):
        first, weights, _ = point_on_curve(x, where)
        return np.array(weights) @ x[first : first + 3]

    found = closest_on_curve(x, min(round(at), 10), at - min(round(at), 10) + 0.1, tuple(curve_m(at)))
    assert np.array(found.offset) == pytest.approx(0.0, abs=1e-12)
    slope = np.array(point_on_curve(x, at)[2])
    assert (curve_m(at + 1e-6) - curve_m(at - 1e-6)) / 2e-6 == pytest.approx(slope, abs=1e-8)


@pytest.mark.parametrize("at", [0.0, 0.2, 49.7, 50.0])
def test_beyond_its_middle_an_end_segment_is_straight(at):
    x = np.zeros((51, 3))
    x[:, 0] = 2e-3 * np.arange(51)
    found = closest_on_curve(x, min(int(at), 49), at - min(int(at), 49), (2e-3 * at, 1e-3, 0.0))
    assert np.array(found.offset) == pytest.approx((0.0, -1e-3, 0.0), abs=1e-15)


def test_the_offset_of_a_kink_that_slides_past_a_point_turns_with_its_way():
    """Turned by 0.5 rad at one particle; seen from 20 um beside it, 20 um further each time."""
    s = 2e-3 * (np.arange(51) - 35)
    x = np.stack([np.where(s > 0, np.cos(0.5) * s, s), np.where(s > 0, np.sin(0.5) * s, 0.0), np.zeros(51)], axis=1)
    direction = []
    for way in np.arange(-1e-3, 1e-3, 20e-6):
        moved = x + np.array((way, 20e-6 - max(-way, 0.0) * np.tan(0.5), 20e-6))
        segment = 34 if way > 0.0 else 35
        offset = np.array(closest_on_curve(moved, segment, 0.5, (0.0, 0.0, 0.0)).offset)
        direction.append(offset / np.linalg.norm(offset))
    turned = np.arccos(np.clip(np.einsum("ij,ij->i", direction[1:], direction[:-1]), -1.0, 1.0))
    assert turned.max() < 0.1
