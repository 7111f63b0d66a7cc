"""The few contacts that everything else relies on, on an undeformed duct where the answer is geometry."""

import numpy as np
import pytest

from services.mechanics.collision import CatheterContactDetector, CollisionSurface, ToolContactDetector
from services.mechanics.collision.pairs import JAW_A, ContactPairs
from services.mechanics.surface.tube import DuctGeometry, parametric_duct

RADIUS_M, HALF_M, CATHETER_M, MARGIN_M = 4e-3, 0.25e-3, 0.8e-3, 0.5e-3


@pytest.fixture(scope="module")
def surface():
    mesh = parametric_duct(DuctGeometry(radius_m=RADIUS_M, length_m=40e-3, n_around=48, n_along=40))
    return CollisionSurface(mesh, np.zeros((mesh.n_vertices, 3, 0)), np.zeros(0), HALF_M)


@pytest.mark.parametrize(("height_m", "side"), [(2.9e-3, -1.0), (5.1e-3, 1.0)])
def test_a_particle_meets_the_wall_from_the_side_it_is_on(surface, height_m, side):
    detector = CatheterContactDetector(surface, 2, CATHETER_M, MARGIN_M)
    pairs = ContactPairs.allocate(16)
    surface.update(np.zeros(0))
    detector.detect(np.array([[20e-3, 0.0, 0.0], [20e-3, height_m, 0.0]]), pairs)
    assert pairs.count == 1
    assert pairs.particle[0] == 1
    assert detector.inside.tolist() == [1, int(side < 0)]
    assert pairs.normal[0] @ [0.0, side, 0.0] == pytest.approx(1.0, abs=5e-3)
    # Flat facets sag by up to R (1 - cos(pi / n)) = 9 um below the circle.
    expected = abs(height_m - RADIUS_M) - HALF_M - CATHETER_M
    assert pairs.gap_m[0] == pytest.approx(expected, abs=9e-6)


def test_a_jaw_lying_on_the_wall_is_carried_by_a_few_spread_points(surface):
    detector = ToolContactDetector(surface, 0, CATHETER_M, MARGIN_M, n_tools=1)
    pairs = ContactPairs.allocate(32)
    surface.update(np.zeros(0))
    y = RADIUS_M + HALF_M + 1e-3 - 0.05e-3
    jaw = [[10e-3, y, 0.0], [25e-3, y, 0.0]]
    far = [[10e-3, 0.2, 0.0], [10e-3, 0.1, 0.0]]
    detector.detect(np.array([[far, jaw, far]]), np.full((1, 3), 1e-3), np.zeros((0, 3)), pairs)
    rows = slice(pairs.count)
    assert 3 <= pairs.count <= 6
    assert (pairs.tool_segment[rows] == JAW_A).all()
    assert np.ptp(pairs.tool_parameter[rows]) > 0.7
    assert pairs.gap_m[rows] == pytest.approx(-0.05e-3, abs=10e-6)
    assert pairs.normal[rows, 1] == pytest.approx(1.0, abs=5e-3)


def test_a_jaw_across_the_catheter_meets_its_segment(surface):
    detector = ToolContactDetector(surface, 3, CATHETER_M, MARGIN_M, n_tools=1)
    pairs = ContactPairs.allocate(32)
    surface.update(np.zeros(0))
    particles = np.array([[0.1, 0.0, 0.0], [0.102, 0.0, 0.0], [0.104, 0.0, 0.0]])
    jaw = [[0.1025, 1.7e-3, -5e-3], [0.1025, 1.7e-3, 10e-3]]
    far = [[10e-3, 0.2, 0.0], [10e-3, 0.1, 0.0]]
    detector.detect(np.array([[far, jaw, far]]), np.full((1, 3), 1e-3), particles, pairs)
    assert pairs.count == 1
    assert pairs.target[0] == 1
    assert pairs.tool_parameter[0] == pytest.approx(1 / 3)
    assert pairs.target_weights[0] == pytest.approx([0.75, 0.25, 0.0])
    assert pairs.gap_m[0] == pytest.approx(-0.1e-3)
    assert pairs.normal[0] == pytest.approx([0.0, 1.0, 0.0])
