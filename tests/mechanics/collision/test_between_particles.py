"""What happens between two particles: segments over the edge of an opening, and the catheter on itself."""

import numpy as np
import pytest
from collision_cases import CATHETER_M, HALF_M, MARGIN_M, RADIUS_M, duct_mesh, rigid_surface, rows

from services.mechanics.collision import CatheterContactDetector, SelfContactDetector
from services.mechanics.collision.pairs import CATHETER_SEGMENT, ContactPairs

THICKNESS_M = CATHETER_M + HALF_M


@pytest.fixture(scope="module")
def duct():
    return rigid_surface(duct_mesh(48, 60))


def detect(detector, positions):
    pairs = ContactPairs.allocate(64)
    detector.detect(np.asarray(positions, float), pairs)
    return rows(pairs)


def over_the_lip(y):
    """Two particles 8 mm apart across the lip at (40, 4, 0) mm, both out of touch with it."""
    return [[37e-3, y - 3e-3, 0.0], [43e-3, y + 3e-3, 0.0]]


@pytest.mark.parametrize("step_m", [0.05e-3, 1e-3])
def test_a_segment_cannot_be_drawn_through_the_lip(duct, step_m):
    detector = CatheterContactDetector(duct, 2, CATHETER_M, MARGIN_M)
    out = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    for y in np.arange(RADIUS_M - 2.2e-3, RADIUS_M + 1.2e-3, step_m):
        duct.update(np.zeros(0))
        distance = (RADIUS_M - y) / np.sqrt(2.0)
        found = [row for row in detect(detector, over_the_lip(y)) if row["tool_parameter"] > 0.0]
        if distance - THICKNESS_M >= MARGIN_M:
            assert not found
            continue
        assert len(found) == 1
        row = found[0]
        assert row["particle"] == 0
        assert row["normal"] == pytest.approx(out, abs=0.06)
        assert row["gap_m"] == pytest.approx(distance - THICKNESS_M, abs=5e-5)
        p = np.array(over_the_lip(y))
        x = p[0] + row["tool_parameter"] * (p[1] - p[0])
        foot = row["target_weights"] @ duct.mesh.vertices_m[duct.mesh.triangles[row["target"]]]
        assert foot[0] == pytest.approx(40e-3, abs=1e-9)
        assert (x - foot) @ row["normal"] == pytest.approx(row["gap_m"] + THICKNESS_M, abs=1e-12)


def test_where_a_segment_meets_the_lip_beside_its_end_it_is_as_near_as_it_is(duct):
    """Up to a twentieth of a segment from a particle that stood for it, as much further off: contacts rattled there."""
    detector = CatheterContactDetector(duct, 2, CATHETER_M, MARGIN_M)
    lip, along = np.array([40e-3, RADIUS_M, 0.0]), np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    out, gap_m = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0), 20e-6
    duct.update(np.zeros(0))
    for share in np.linspace(0.2, -0.02, 23):
        first = lip + (THICKNESS_M + gap_m) * out - share * 6e-3 * along
        found = detect(detector, [first, first + 6e-3 * along])
        nearest_m = np.hypot(THICKNESS_M + gap_m, min(share, 0.0) * 6e-3) - THICKNESS_M
        assert min(row["gap_m"] for row in found) == pytest.approx(nearest_m, abs=1.5e-6)  # its neighbours bend


def test_where_the_rim_bends_a_segment_touches_it_on_both_sides():
    mesh = duct_mesh()
    detector = CatheterContactDetector(rigid_surface(mesh), 2, CATHETER_M, MARGIN_M)
    y = RADIUS_M - THICKNESS_M
    found = [row for row in detect(detector, [[37e-3, y, 0.0], [43e-3, y, 0.0]]) if row["tool_parameter"] > 0.0]
    assert len(found) == 2
    assert sorted(np.sign(row["normal"][2]) for row in found) == [-1.0, 1.0]
    for row in found:
        assert row["normal"] @ [0.0, -1.0, 0.0] == pytest.approx(np.cos(np.pi / 24), abs=1e-6)


def test_in_a_narrow_mouth_the_other_lip_is_not_the_far_side_of_this_one():
    mesh = duct_mesh(48, 60)
    flat = np.zeros((mesh.n_vertices, 3, 1))
    flat[:, 1, 0] = -mesh.vertices_m[:, 1]
    surface = type(rigid_surface(mesh))(mesh, flat, np.ones(1), HALF_M)
    detector = CatheterContactDetector(surface, 2, CATHETER_M, MARGIN_M)
    surface.update(np.array([0.7]))
    for y in 0.1e-3 * np.sin(np.linspace(0.0, 20.0, 50)):
        found = detect(detector, [[38.7e-3, y, 0.0], [42e-3, y, 0.0]])
        assert {np.sign(row["normal"][1]) for row in found} == {-1.0, 1.0}, "both lips are within reach"
        assert min(row["gap_m"] for row in found) > -0.2e-3


def loop_of(n=60, radius_m=12e-3, rise_m=4e-3):
    turn = np.linspace(0.0, 2.4 * np.pi, n)
    return np.stack([radius_m * np.cos(turn), radius_m * np.sin(turn), rise_m * turn / (2.0 * np.pi)], axis=1)


def test_a_loop_meets_itself_and_is_not_drawn_through():
    detector = SelfContactDetector(60, CATHETER_M, MARGIN_M)
    seen = 0
    for rise in np.arange(4e-3, -1e-3, -0.05e-3):
        found = detect(detector, loop_of(rise_m=rise))
        if rise > 2.0 * CATHETER_M + MARGIN_M + 0.1e-3:
            assert not found
        if rise > 2.0 * CATHETER_M + MARGIN_M - 0.1e-3:
            continue
        seen += 1
        assert all(row["target_kind"] == CATHETER_SEGMENT for row in found)
        assert min(row["gap_m"] for row in found) == pytest.approx(rise - 2.0 * CATHETER_M, abs=0.1e-3)
        deepest = min(found, key=lambda row: row["gap_m"])
        assert deepest["particle"] < deepest["target"]
        assert deepest["normal"][2] < -0.9, "the first turn lies below the second and stays there"
    assert seen > 40


def test_neighbours_do_not_meet():
    straight = np.stack([np.linspace(0.0, 0.1, 51), np.zeros(51), np.zeros(51)], axis=1)
    assert not detect(SelfContactDetector(51, CATHETER_M, 0.1e-3), straight)
    with pytest.raises(ValueError, match="n_apart"):
        SelfContactDetector(51, CATHETER_M, MARGIN_M, n_apart=1)
