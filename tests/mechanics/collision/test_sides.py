"""On which side of a wall something is: what has crossed nothing is where it was."""

import numpy as np
import pytest
from collision_cases import CATHETER_M, HALF_M, LENGTH_M, MARGIN_M, RADIUS_M, duct_mesh, rigid_surface, rows
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.collision.tools import ToolContactDetector

JAW_M, ROOM_M = 1e-3, HALF_M + 1e-3
AWAY = np.array([[0.3, 0.3, 0.3], [0.3, 0.3, 0.31]])
RADII = np.array([[2.5e-3, JAW_M, JAW_M]])
MESH = duct_mesh()
#: A polygon of 24 sides is nearer to the axis than its corners are.
INSIDE_M = RADIUS_M * np.cos(np.pi / 24) - ROOM_M

shares = st.floats(0.0, 1.0)
steps = st.lists(st.tuples(shares, shares, shares), min_size=2, max_size=30)


def seen_on_a_way(places_m):
    """Take a jaw of 2 mm along the duct to each place (3,) in turn; return how many pairs were found."""
    detector, found = ToolContactDetector(rigid_surface(MESH), 0, CATHETER_M, MARGIN_M, 1), 0
    for at in places_m:
        jaw = np.array([at, at + np.array([2e-3, 0.0, 0.0])])
        pairs = ContactPairs.allocate(64)
        detector.detect(np.array([[AWAY, jaw, AWAY]]), RADII, np.zeros((0, 3)), pairs)
        for row in rows(pairs):
            p = jaw[0] + row["tool_parameter"] * (jaw[1] - jaw[0])
            foot = row["target_weights"] @ MESH.vertices_m[MESH.triangles[row["target"]]]
            assert (p - foot) @ row["normal"] == pytest.approx(np.linalg.norm(p - foot), abs=1e-12)
            assert row["gap_m"] > -1e-12
        found += pairs.count
    return found


@settings(max_examples=60)
@given(steps)
def test_a_jaw_that_stays_in_the_lumen_is_never_seen_outside(steps):
    """However it jumps: the lumen is convex, so no straight way within it crosses the wall."""
    places_m = []
    for along, out, turned in steps:
        angle, away_m = 2.0 * np.pi * turned, np.sqrt(out) * INSIDE_M
        x_m = 8e-3 + along * (LENGTH_M - 18e-3)
        places_m.append(np.array([x_m, away_m * np.cos(angle), away_m * np.sin(angle)]))
    seen_on_a_way(places_m)


@settings(max_examples=60)
@given(steps)
def test_a_jaw_that_goes_round_the_duct_is_never_seen_inside(steps):
    """By at most a third of a radian at once: so far the straight way between two places is outside."""
    places_m, angle = [], 0.0
    for along, out, turned in steps:
        angle += 0.6 * (turned - 0.5)
        away_m = 1.05 * (RADIUS_M + ROOM_M) + out * 1e-3
        x_m = 8e-3 + along * (LENGTH_M - 18e-3)
        places_m.append(np.array([x_m, away_m * np.cos(angle), away_m * np.sin(angle)]))
    seen_on_a_way(places_m)


def test_a_jaw_beside_the_wall_is_seen_on_either_side():
    for away_m in (INSIDE_M - 0.1e-3, RADIUS_M + ROOM_M + 0.1e-3):
        assert seen_on_a_way([np.array([20e-3, away_m, 0.0])]) > 0
