"""Particles against the wall: side, normal and gap, the way in, and no way through."""

import numpy as np
import pytest
from collision_cases import (
    CATHETER_M,
    HALF_M,
    MARGIN_M,
    RADIUS_M,
    deformed,
    distances_to_triangles,
    duct_mesh,
    random_coordinates,
    rigid_surface,
    rows,
    wavy_surface,
)

from services.mechanics.collision import CatheterContactDetector, CollisionSurface
from services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs

THICKNESS_M = CATHETER_M + HALF_M
NO_MODES = np.zeros(0)


@pytest.fixture(scope="module")
def duct():
    return rigid_surface(duct_mesh(48, 60))


def detector_of(surface, n=1):
    return CatheterContactDetector(surface, n, CATHETER_M, MARGIN_M)


def detect(detector, positions):
    pairs = ContactPairs.allocate(4 * len(positions) + 4)
    detector.detect(np.atleast_2d(np.asarray(positions, float)), pairs)
    return rows(pairs)


def path(start, end, step_m):
    start, end = np.asarray(start, float), np.asarray(end, float)
    n = max(1, int(np.ceil(np.linalg.norm(end - start) / step_m)))
    return [start + (end - start) * k / n for k in range(n + 1)]


def _answers(found, without):
    """What is within the margin; whatever approaches may be reported before."""
    answers = [(int(r["particle"]), int(r["target"]), float(r["gap_m"])) for r in found if r["gap_m"] < MARGIN_M]
    return [answer for answer in answers if answer[0] not in without]


def test_pairs_agree_with_brute_force_while_everything_moves():
    """Weights, normal and gap are those of the closest point at every tick of a coherent motion, and the
    answer is the one that a detector without a past gives."""
    rng = np.random.default_rng(2)
    surface = wavy_surface(duct_mesh(), rng)
    detector, n = detector_of(surface, 12), 12
    q, drift = random_coordinates(rng, 1e-3), random_coordinates(rng, 0.03e-3)
    x = np.stack([np.linspace(5e-3, 35e-3, n), rng.uniform(-3e-3, 3e-3, n), rng.uniform(-3e-3, 3e-3, n)], 1)
    velocity = rng.normal(size=(n, 3)) * 0.03e-3
    seen = 0
    for _ in range(60):
        q, x = q + drift, x + velocity
        surface.update(q)
        vertices = deformed(surface)
        found = detect(detector, x)
        for particle, p in enumerate(x):
            expected = distances_to_triangles(p, vertices, surface.mesh.triangles)
            mine = [row for row in found if row["particle"] == particle]
            if any(row["gap_m"] < -THICKNESS_M for row in mine):
                continue  # beyond the middle of the wall: held from its side, not to the closest point
            if expected.min() - THICKNESS_M >= MARGIN_M:
                assert not mine or expected.min() - THICKNESS_M < MARGIN_M + np.linalg.norm(velocity[particle])
                continue
            seen += 1
            row = min(mine, key=lambda r: r["gap_m"])
            assert row["gap_m"] + THICKNESS_M == pytest.approx(expected.min(), abs=1e-12)
            foot = row["target_weights"] @ vertices[surface.mesh.triangles[row["target"]]]
            assert row["target_weights"].sum() == pytest.approx(1.0)
            assert np.linalg.norm(row["normal"]) == pytest.approx(1.0)
            assert (p - foot) @ row["normal"] == pytest.approx(row["gap_m"] + THICKNESS_M, abs=1e-12)
            assert (row["tool"], row["target_kind"], row["tool_parameter"]) == (NO_TOOL, DUCT_TRIANGLE, 0.0)
        crossed = {int(row["particle"]) for row in found if row["gap_m"] < -THICKNESS_M}
        fresh = detect(detector_of(surface, n), x)
        assert _answers(fresh, crossed) == _answers(found, crossed)
    assert seen > 200


@pytest.mark.parametrize("speed_m_s", [0.02, 1.0, 4.0, 15.0])
@pytest.mark.parametrize("origin", ["outside", "inside"])
def test_no_particle_passes_the_wall_unnoticed(duct, speed_m_s, origin):
    """Driven through the wall by force, a particle is pushed back to its side, and its flag stays."""
    rng = np.random.default_rng(4)
    sign = 1.0 if origin == "outside" else -1.0
    for _ in range(25):
        angle, x = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(3e-3, 37e-3)
        out = np.array([0.0, np.cos(angle), np.sin(angle)])
        tilt = np.array([rng.uniform(-1e-3, 1e-3), 0.0, 0.0])
        start = [x, 0, 0] + (RADIUS_M + sign * (3e-3 + rng.uniform(0, 1e-3))) * out
        end = [x, 0, 0] + (RADIUS_M - sign * 1.5e-3) * out + tilt
        detector = detector_of(duct)
        was = None
        for p in path(start, end, speed_m_s * 1e-3):
            duct.update(NO_MODES)
            found = detect(detector, p)
            was = detector.inside[0] if was is None else was
            assert detector.inside[0] == was == (origin == "inside")
        assert found, "the wall is within reach and nothing is reported"
        deepest = min(found, key=lambda row: row["gap_m"])
        assert sign * deepest["normal"] @ out > 0.95
        assert deepest["gap_m"] == pytest.approx(-1.5e-3 - THICKNESS_M, abs=0.05e-3)


@pytest.mark.parametrize("speed_m_s", [0.02, 1.0, 4.0])
@pytest.mark.parametrize("height_m", [0.0, 2.5e-3, -3.2e-3])
def test_through_the_mouth_leads_inside_and_out_again(duct, speed_m_s, height_m):
    detector = detector_of(duct)
    y, z = 0.8 * height_m, 0.6 * height_m
    way = path([46e-3, y, z], [30e-3, y, z], speed_m_s * 1e-3)
    is_in_reach = RADIUS_M - abs(height_m) < THICKNESS_M + MARGIN_M
    for p in [*way, *way[::-1]]:
        duct.update(NO_MODES)
        found = detect(detector, p)
        assert all(row["gap_m"] > -THICKNESS_M for row in found), f"pushed to the wrong side at {p}"
        if abs(p[0] - 40e-3) > 1e-3:
            assert detector.inside[0] == (p[0] < 40e-3)
            assert found or not is_in_reach or p[0] > 40e-3, f"the wall beside {p} is not seen"


def test_beside_the_mouth_stays_outside_and_is_pushed_outwards(duct):
    detector = detector_of(duct)
    for p in path([46e-3, 4.7e-3, 0.0], [30e-3, 4.7e-3, 0.0], 1e-3):
        duct.update(NO_MODES)
        found = detect(detector, p)
        assert detector.inside[0] == 0
    assert found[0]["normal"][1] == pytest.approx(1.0, abs=1e-2)
    assert found[0]["gap_m"] == pytest.approx(0.7e-3 - THICKNESS_M, abs=0.02e-3)


def dented(seed):
    """A duct whose first coordinate dents its rim: ears of its cap fold over there, and lie outside of the lumen.

    The other one, in m, moves its other end aside, of which the mouth has nothing but a bound of how far walls went.
    """
    mesh, rng = duct_mesh(20, 26), np.random.default_rng(seed)
    rim = np.flatnonzero(np.isclose(mesh.vertices_m[:, 0], 40e-3))
    modes = np.zeros((mesh.n_vertices, 3, 2))
    modes[rim, 1:, 0] = -mesh.vertices_m[rim, 1:] * rng.uniform(0.0, 0.6, (len(rim), 1))
    modes[mesh.vertices_m[:, 0] < 10e-3, 1, 1] = 1.0
    return CollisionSurface(mesh, modes, np.ones(2), HALF_M)


@pytest.mark.parametrize("shake_m", [0.0, 5e-3])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_who_is_flung_to_where_a_dented_rim_folds_its_cap_is_not_in_the_lumen(seed, shake_m):
    """Of 600 ways to a rim at rest 25 ended in the lumen once; where a wall shakes who came how near is unsure."""
    surface, rng = dented(seed), np.random.default_rng(seed)
    for _ in range(200):
        angle, way = rng.uniform(0.0, 2.0 * np.pi), rng.normal(size=3)
        out = np.array([0.0, np.cos(angle), np.sin(angle)])
        aim = np.array([40e-3 + rng.uniform(0.1e-3, 3e-3), 0.0, 0.0]) + rng.uniform(3.5e-3, 6e-3) * out
        detector, shape = detector_of(surface), np.zeros(2)
        for p in path(aim + 8e-3 * np.abs(way) * np.sign(aim) / np.linalg.norm(way), aim, 0.9e-3):
            surface.update(shape)
            detect(detector, p)
            shape = np.array([1.0, shake_m * rng.normal()])
            assert detector.inside[0] == 0, (aim, p)


@pytest.mark.parametrize("shake_m", [0.0, 5e-3])
@pytest.mark.parametrize("speed_m_s", [0.02, 1.0, 4.0])
def test_a_dented_mouth_lets_in_and_out_as_any(speed_m_s, shake_m):
    surface, rng = dented(1), np.random.default_rng(1)
    detector = detector_of(surface)
    way = path([46e-3, 0.0, 0.0], [30e-3, 0.0, 0.0], speed_m_s * 1e-3)
    for p in [*way, *way[::-1]]:
        surface.update(np.array([1.0, shake_m * rng.normal()]))
        detect(detector, p)
        if abs(p[0] - 40e-3) > 1e-3:
            assert detector.inside[0] == (p[0] < 40e-3)


def test_head_on_against_the_rim_is_pushed_back_along_the_duct(duct):
    detector = detector_of(duct)
    for p in path([46e-3, RADIUS_M, 0.0], [40.5e-3, RADIUS_M, 0.0], 0.2e-3):
        duct.update(NO_MODES)
        found = detect(detector, p)
    assert len(found) == 1
    assert found[0]["normal"] == pytest.approx([1.0, 0.0, 0.0], abs=1e-2)
    assert found[0]["gap_m"] == pytest.approx(0.5e-3 - THICKNESS_M, abs=1e-5)


def test_around_the_rim_from_outside_to_inside_never_meets_the_wrong_side(duct):
    """Half a circle round the lip, just out of touch: a continuous gap and a normal that turns with it."""
    detector, radius = detector_of(duct), THICKNESS_M + 0.05e-3
    last = None
    arc = [np.array([40e-3 + radius * np.sin(a), RADIUS_M + radius * np.cos(a), 0]) for a in np.linspace(0, np.pi, 80)]
    inwards = path(arc[-1], arc[-1] - [5e-3, 0, 0], 0.1e-3)
    for p in [*path(arc[0] - [5e-3, 0, 0], arc[0], 0.1e-3), *arc, *inwards]:
        duct.update(NO_MODES)
        found = detect(detector, p)
        assert len(found) == 1
        assert found[0]["gap_m"] == pytest.approx(0.05e-3, abs=0.01e-3)
        if last is not None:
            assert found[0]["normal"] @ last > 0.98
        last = found[0]["normal"]
    assert detector.inside[0] == 1


def test_an_oblique_mouth_is_not_mistaken_for_a_wall():
    """In front of the cap but within the longer lip, a particle touches that lip's inner face."""
    duct = rigid_surface(duct_mesh(48, 60, cut_angle_rad=0.7))
    lip = deformed(duct)[duct.mesh.vertex_sets["mouth"]]
    longest = lip[np.argmax(lip[:, 0])]
    detector = detector_of(duct)
    side = np.sign(longest[1])
    y = longest[1] - side * (THICKNESS_M + 0.1e-3)
    touched = 0
    for p in path([longest[0] + 3e-3, y, 0.0], [longest[0] - 8e-3, y, 0.0], 0.3e-3):
        duct.update(NO_MODES)
        for row in detect(detector, p):
            touched += 1
            assert row["gap_m"] > -0.1e-3
            assert side * row["normal"][1] < 0.0, "the lip's inner face"
    assert touched > 20
    assert detector.inside[0] == 1


def test_a_slit_lets_a_particle_in():
    duct = rigid_surface(duct_mesh(48, 60, slit_length_m=15e-3, slit_width_m=5e-3))
    lips = deformed(duct)[duct.mesh.vertex_sets["mouth"]]
    angle = np.arctan2(lips[:, 2], lips[:, 1])[lips[:, 0] > 35e-3]
    assert np.abs(angle).min() > 0.3, "the slit is about the +y side"
    detector = detector_of(duct)
    for p in path([36e-3, 9e-3, 0.0], [36e-3, 0.0, 0.0], 0.3e-3):
        duct.update(NO_MODES)
        found = detect(detector, p)
    assert not found
    assert detector.inside[0] == 1


def test_teleport_and_reset_find_the_truth_again(duct):
    detector = detector_of(duct)
    for place, inside in [([20e-3, 0, 0], 1), ([20e-3, 30e-3, 0], 0), ([39e-3, 3.5e-3, 0], 1), ([41e-3, 0, 0], 0)]:
        detect(detector, [0.5, 0.5, 0.5])
        detect(detector, place)
        assert detector.inside[0] == inside
    detector.reset()
    detect(detector, [20e-3, 3.9e-3, 0])
    assert detector.inside[0] == 1


@pytest.mark.parametrize("nowhere", [np.nan, np.inf, -np.inf, 1e200])
def test_a_position_that_is_none_touches_nothing_and_is_forgotten(duct, nowhere):
    detector, touching = detector_of(duct, 2), [20e-3, 3e-3, 0]
    for positions in ([touching, touching], [[20e-3, nowhere, 0], touching], [touching, touching]):
        expected = [k for k in range(2) if positions[k] == touching]
        assert [int(row["particle"]) for row in detect(detector, positions)] == expected


@pytest.mark.parametrize(
    ("q", "node", "displacement", "reason"),
    [
        (np.full(12, np.nan), 3, 0.0, "finite"),
        (np.zeros(12), 3, np.inf, "finite"),
        (np.zeros(12), 750, 0.0, "exist"),
        (np.zeros(12), -1, 0.0, "exist"),
        (np.zeros(11), 3, 0.0, "do not fit 12 modes"),
    ],
)
def test_a_wall_that_is_nowhere_is_refused_and_the_old_one_stays(q, node, displacement, reason):
    surface = wavy_surface(duct_mesh(), np.random.default_rng(0))
    surface.update(np.full(12, 1e-3))
    before = deformed(surface)
    with pytest.raises(ValueError, match=reason):
        surface.update(q, np.array([node], np.int32), np.full((1, 3), displacement))
    assert deformed(surface) == pytest.approx(before, abs=0.0)


def test_arrays_of_another_size_are_refused(duct):
    with pytest.raises(ValueError, match=r"shape \(3, 3\), not \(2, 3\)"):
        detect(detector_of(duct, 2), np.zeros((3, 3)))


def test_a_pinched_lumen_holds_the_catheter_from_both_sides():
    mesh = duct_mesh(48, 60)
    flat = np.zeros((mesh.n_vertices, 3, 1))
    flat[:, 1, 0] = -mesh.vertices_m[:, 1]
    surface = type(rigid_surface(mesh))(mesh, flat, np.ones(1), HALF_M)
    detector = detector_of(surface)
    for closing in np.linspace(0.0, 0.76, 200):
        surface.update(np.array([closing]))
        found = detect(detector, [20e-3, 0.0, 0.0])
    assert sorted(round(float(row["normal"][1])) for row in found) == [-1, 1]
    for row in found:
        assert row["gap_m"] == pytest.approx(0.24 * RADIUS_M - THICKNESS_M, abs=0.02e-3)


def in_a_fold(mesh, height_m):
    """A place over an edge along the inside of the duct, this high above both flanks, and the two normals."""
    across = 2.0 * np.pi / 24
    flanks = [-np.array([0.0, np.cos(a), np.sin(a)]) for a in (0.5 * across, -0.5 * across)]
    return np.array([20.3e-3, RADIUS_M - height_m / np.cos(0.5 * across), 0.0]), flanks


@pytest.mark.parametrize("sideways_m", [0.0, 0.1e-3, -0.1e-3])
def test_in_a_fold_of_the_wall_both_flanks_are_touched(sideways_m):
    mesh = duct_mesh()
    place, flanks = in_a_fold(mesh, THICKNESS_M)
    found = detect(detector_of(rigid_surface(mesh)), place + np.array([0.0, 0.0, sideways_m]))
    assert len(found) == 2
    for flank in flanks:
        row = max(found, key=lambda r: r["normal"] @ flank)
        assert row["normal"] == pytest.approx(flank, abs=1e-9)
        assert row["gap_m"] == pytest.approx(sideways_m * flank[2], abs=1e-9)


def test_a_fast_particle_meets_what_a_slow_one_does_not_yet(duct):
    for speed_m, expected in ((0.1e-3, 0), (0.6e-3, 1)):
        detector = detector_of(duct)
        for height in (THICKNESS_M + 0.9e-3 + speed_m, THICKNESS_M + 0.9e-3):
            duct.update(NO_MODES)
            found = detect(detector, [20e-3, RADIUS_M - height, 0.0])
        assert len(found) == expected


def test_a_particle_that_slides_past_a_fold_in_one_tick_has_met_its_far_flank():
    """Along one flank, from where the other lies beside it and not below: 0.6 mm on it would be in the other one."""
    mesh = duct_mesh()
    surface, (fold, flanks) = rigid_surface(mesh), in_a_fold(mesh, THICKNESS_M + 0.01e-3)
    slide = np.cross([1.0, 0.0, 0.0], flanks[0])
    slide *= np.sign(slide @ (flanks[0] - flanks[1]))
    for speed_m, expected in ((0.0, 1), (0.6e-3, 2)):
        detector = detector_of(surface)
        for back in (0.5e-3 + speed_m, 0.5e-3):
            surface.update(NO_MODES)
            found = detect(detector, fold - back * slide)
        assert len(found) == expected
