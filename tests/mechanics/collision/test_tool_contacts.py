"""Forceps against the duct and the catheter: sides kept at any speed, few and steady points, all accounted for."""

import tracemalloc

import numpy as np
import pytest
from collision_cases import (
    CATHETER_M,
    HALF_M,
    MARGIN_M,
    RADIUS_M,
    carried_surface,
    deformed,
    distance_of_hulls,
    duct_mesh,
    nearest_candidates,
    random_coordinates,
    rigid_surface,
    rows,
    wavy_surface,
)

from services.mechanics.collision import (
    CatheterContactDetector,
    CollisionSurface,
    ToolContactDetector,
    search,
    sides,
)
from services.mechanics.collision.pairs import CATHETER_SEGMENT, DUCT_TRIANGLE, JAW_A, JAW_B, SHAFT, ContactPairs
from services.mechanics.surface.mesh import TriangleMesh

SHAFT_M, JAW_M = 2.5e-3, 1e-3
RADII = np.array([[SHAFT_M, JAW_M, JAW_M]])
NO_CATHETER = np.zeros((0, 3))
AWAY = np.array([[0.3, 0.3, 0.3], [0.3, 0.3, 0.31]])


@pytest.fixture(scope="module")
def duct():
    return rigid_surface(duct_mesh(36, 45))


def one_jaw(start, end):
    return np.array([[AWAY, [start, end], AWAY]])


def forceps(junction, port, opening_rad=0.6, jaw_m=15e-3):
    """Shaft and jaws of one tool, the jaws opening along y."""
    junction, port = np.asarray(junction, float), np.asarray(port, float)
    d = (junction - port) / np.linalg.norm(junction - port)
    side = np.array([0.0, 1.0, 0.0])
    jaws = [
        junction + jaw_m * (np.cos(opening_rad / 2) * d + sign * np.sin(opening_rad / 2) * side) for sign in (1, -1)
    ]
    return np.array([[[port, junction], [junction, jaws[0]], [junction, jaws[1]]]])


def detect(detector, segments, catheter=NO_CATHETER, capacity=64, **options):
    pairs = ContactPairs.allocate(capacity)
    detector.detect(segments, np.repeat(RADII, len(segments), axis=0), catheter, pairs, **options)
    return rows(pairs)


def tool_detector(surface, n_particles=0, n_tools=1):
    return ToolContactDetector(surface, n_particles, CATHETER_M, MARGIN_M, n_tools)


def test_pairs_agree_with_brute_force_while_everything_moves():
    rng = np.random.default_rng(6)
    surface = wavy_surface(duct_mesh(), rng)
    detector = tool_detector(surface)
    q, drift = random_coordinates(rng, 0.5e-3), random_coordinates(rng, 0.02e-3)
    seen = 0
    for tick in range(50):
        q = q + drift
        surface.update(q)
        vertices = deformed(surface)
        top = vertices[:, 1].max() + HALF_M + JAW_M
        start = np.array([14e-3 + tick * 0.05e-3, top + 0.4e-3 - tick * 0.01e-3, 1e-3])
        jaw = np.array([start, start + np.array([12e-3, -0.3e-3, 2e-3])])
        found = detect(detector, one_jaw(*jaw))
        near = nearest_candidates(jaw, vertices, surface.mesh.triangles)
        corners = vertices[surface.mesh.triangles[near]]
        expected = min(distance_of_hulls(jaw, corner) for corner in corners) - JAW_M - HALF_M
        if expected >= MARGIN_M:
            assert not found
            continue
        seen += 1
        assert min(row["gap_m"] for row in found) == pytest.approx(expected, abs=1e-12)
        for row in found:
            assert (row["tool_segment"], row["target_kind"], row["particle"]) == (JAW_A, DUCT_TRIANGLE, -1)
            p = jaw[0] + row["tool_parameter"] * (jaw[1] - jaw[0])
            foot = row["target_weights"] @ vertices[surface.mesh.triangles[row["target"]]]
            assert (p - foot) @ row["normal"] == pytest.approx(row["gap_m"] + JAW_M + HALF_M, abs=1e-12)
            assert np.linalg.norm(p - foot) == pytest.approx(row["gap_m"] + JAW_M + HALF_M, abs=1e-12)
            beyond = (foot - p) @ (jaw[1] - jaw[0]) / np.linalg.norm(jaw[1] - jaw[0])
            s = row["tool_parameter"]
            assert abs(beyond) < 1e-12 or (s == 0.0 and beyond < 0.0) or (s == 1.0 and beyond > 0.0), "of the whole jaw"
    assert seen > 25


@pytest.mark.parametrize("squeezed", [1.0, 1.1, 2.0])
def test_a_jaw_off_a_fold_stays_there_when_the_fold_turns_inside_out(squeezed):
    """Jaws squeeze a fold until its flanks pass each other: the normals at its edge then point inwards.

    Before, a jaw two millimetres off was told to be as deep in the wall.
    """
    wide, high, long = 3e-3, 4e-3, 20e-3
    vertices = np.array([[x, y, z] for x, z in ((-wide, 0.0), (0.0, high), (wide, 0.0)) for y in (-long, long)])
    mesh = TriangleMesh(vertices, np.array([[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]], np.int32))
    to_the_middle = np.zeros((len(vertices), 3, 1))
    to_the_middle[:, 0, 0] = -vertices[:, 0]
    surface = CollisionSurface(mesh, to_the_middle, np.ones(1), HALF_M)
    detector, above = tool_detector(surface), high + JAW_M + HALF_M + 0.2e-3
    jaw = one_jaw([-1e-3, -4e-3, above], [1e-3, 5e-3, above])
    for share in np.linspace(0.0, squeezed, 40):
        surface.update(np.array([share]))
        found = detect(detector, jaw)
        assert min(pair["gap_m"] for pair in found) == pytest.approx(0.2e-3, abs=1e-6)
        assert min(pair["normal"][2] for pair in found) > 0.7


@pytest.mark.parametrize("away_mm", [0.3, 1.1, 2.0])
def test_a_jaw_that_was_far_from_the_wall_is_not_beyond_it_a_tick_later(away_mm):
    """What a piece of a jaw followed slid from the ridge of a fold to its flank, which shows its inside there.

    Before, jaws that opened were told to be four millimetres deep in the fold that they had let go.
    """
    triangle = TriangleMesh(np.array([[0.0, 0, 0], [20e-3, 0, 0], [0, 20e-3, 0]]), np.array([[0, 1, 2]], np.int32))
    shell, height = rigid_surface(triangle).shell, -1e-3 * away_mm  # on the inside, the normal being along z
    ends = (4e-3, 4e-3, height), (6e-3, 4e-3, height - 1e-3)
    touch = search.touch_triangle(shell.body, shell.wall, 0, *ends)
    reach_m, sideways = 2.5e-3, (0.9, 0.0, -0.43)
    for past_m in (2.3e-3, 0.2e-3):
        past = (sides.OUTSIDE, sideways, past_m)
        _, normal, distance, side = sides.contact_followed(shell.body, shell.wall, touch, ends, past, reach_m)
        is_far = past_m + abs(height) > reach_m
        assert side == (sides.INSIDE if is_far else sides.OUTSIDE)
        assert normal[2] == (-1.0 if is_far else 1.0)
        assert (distance > 0.0) == is_far


@pytest.mark.parametrize("speed_m_s", [0.05, 1.0, 5.0, 15.0])
@pytest.mark.parametrize("origin", ["outside", "inside"])
def test_no_jaw_passes_the_wall_unnoticed(duct, speed_m_s, origin):
    rng = np.random.default_rng(9)
    sign = 1.0 if origin == "outside" else -1.0
    begin, stop = (8e-3, 2.5e-3) if origin == "outside" else (1.5e-3, 5.5e-3)
    for _ in range(15):
        angle = rng.uniform(0.0, 2.0 * np.pi)
        out = np.array([0.0, np.cos(angle), np.sin(angle)])
        along = np.array([1.0, 0.0, 0.0]) + 0.1 * rng.normal(size=3)
        detector = tool_detector(duct)
        n = max(1, int(np.ceil(abs(stop - begin) / (speed_m_s * 1e-3))))
        for height in np.linspace(begin, stop, n + 1):
            duct.update(np.zeros(0))
            centre = height * out + [20e-3, 0.0, 0.0]
            found = detect(detector, one_jaw(centre - 6e-3 * along, centre + 6e-3 * along))
        assert found
        deepest = min(found, key=lambda row: row["gap_m"])
        assert deepest["gap_m"] < -HALF_M - JAW_M - 0.5e-3
        assert sign * deepest["normal"] @ out > 0.8


@pytest.mark.parametrize("speed_m_s", [0.05, 1.0, 5.0])
def test_a_tip_pushed_through_the_wall_is_pushed_back(duct, speed_m_s):
    detector, gaps = tool_detector(duct), []
    depth = np.arange(-4e-3, 2e-3, speed_m_s * 1e-3)
    for d in depth:
        duct.update(np.zeros(0))
        tip = np.array([20e-3, RADIUS_M - d, 0.0])
        found = detect(detector, one_jaw(tip + np.array([2e-3, 12e-3, 0.0]), tip))
        if found:
            deepest = min(found, key=lambda row: row["gap_m"])
            gaps.append((d, deepest["gap_m"]))
            assert deepest["normal"][1] > 0.9
    d, gap = np.array(gaps).T
    assert d.tolist() == depth[len(depth) - len(d) :].tolist(), "once touched, touched to the end"
    assert d[0] <= depth[depth > -HALF_M - JAW_M][0], "met when it is touched"
    assert gap == pytest.approx(-d - HALF_M - JAW_M, abs=0.03e-3)


@pytest.mark.parametrize("seed", range(4))
def test_what_a_jaw_will_meet_within_a_tick_is_among_its_points(seed):
    """Where a wall gives way at the closest point only, the jaw goes on into its neighbours."""
    rng = np.random.default_rng(seed)
    surface = wavy_surface(duct_mesh(20, 26), rng)
    surface.update(random_coordinates(rng, 0.3e-3))
    vertices = deformed(surface)
    corners = vertices[surface.mesh.triangles]
    grid = np.array([[i, j, 6 - i - j] for i in range(7) for j in range(7 - i)]) / 6.0
    wall = (grid @ corners).reshape(-1, 3)
    along = np.array([1.0, 0.0, 0.0]) + 0.2 * rng.normal(size=3)
    along[1] = 0.0
    jaw = np.array([20e-3, 0.0, 0.0]) + np.outer([-7e-3, 7e-3], along)
    up, met = np.array([0.0, 1.0, 0.0]), 0
    reach = JAW_M + HALF_M
    height = max((axis_distances(wall, jaw + y * up).min() < reach) * y for y in np.linspace(3e-3, 8e-3, 500))
    longest_edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    detector = tool_detector(surface)
    for tick in range(-3, 2):
        here = jaw + (height - 0.3e-3 * tick) * up
        surface.update(surface.shell.body.q.copy())
        found = detect(detector, one_jaw(*here))
        will_touch = wall[axis_distances(wall, here - 0.3e-3 * up) < reach - 0.02e-3]
        feet = np.array([row["target_weights"] @ corners[row["target"]] for row in found]).reshape(-1, 3)
        for point in will_touch:
            met += 1
            assert np.linalg.norm(feet - point, axis=1).min() < 0.75 * longest_edge
    assert met > 30


def test_it_is_the_same_whether_a_jaw_slides_or_the_wall_under_it():
    """What is met within a tick depends on how both move, not on who does: a wall that snaps meets jaws at rest."""
    mesh, found = duct_mesh(20, 26), {}
    jaw = np.array([[12e-3, RADIUS_M + HALF_M + JAW_M - 0.05e-3, 1e-3], [27e-3, RADIUS_M + HALF_M + JAW_M, 2e-3]])
    for who in ("nobody", "jaw", "wall"):
        surface = carried_surface(mesh)
        detector = tool_detector(surface)
        for tick in range(6):
            way = (tick - 5) * np.array([0.2e-3, 0.0, -0.1e-3]) * (who != "nobody")
            surface.update(-way if who == "wall" else np.zeros(3))
            pairs = detect(detector, one_jaw(*(jaw + (way if who == "jaw" else 0.0))))
        found[who] = sorted((int(row["target"]), round(1e9 * float(row["gap_m"]))) for row in pairs)
    assert found["wall"] == found["jaw"]
    assert len(found["jaw"]) > len(found["nobody"])


def axis_distances(points, ends):
    """Distances of points (n, 3) from the segment between ends (2, 3)."""
    axis = ends[1] - ends[0]
    s = np.clip((points - ends[0]) @ axis / (axis @ axis), 0.0, 1.0)
    return np.linalg.norm(points - ends[0] - s[:, None] * axis, axis=1)


def test_a_jaw_on_the_wall_rests_on_few_points_that_stay(duct):
    """Sliding along the wall by a triangle or more, the points keep their places on the jaw."""
    detector, last, compared = tool_detector(duct), None, 0
    y = RADIUS_M + HALF_M + JAW_M - 0.1e-3
    for shift in np.linspace(0.0, 3e-3, 150):
        duct.update(np.zeros(0))
        found = detect(detector, one_jaw([8e-3 + shift, y, 0.0], [23e-3 + shift, y, 0.0]))
        places = np.sort([row["tool_parameter"] for row in found])
        assert 3 <= len(found) <= 6
        assert np.ptp(places) > 0.6
        if last is not None and len(places) == len(last):
            assert np.abs(places - last).max() <= 0.2, "a point left its stretch of the jaw"
            compared += 1
        last = places
    assert compared > 100


def bulging_patch(centre_m, width_m):
    """A flat patch of wall, 12 by 4 mm, whose coordinates, in m, raise bulges of this width at places along x."""
    x, y = np.linspace(-6e-3, 6e-3, 61), np.linspace(-2e-3, 2e-3, 21)
    vertices = np.zeros((x.size * y.size, 3))
    vertices[:, 0], vertices[:, 1] = np.repeat(x, y.size), np.tile(y, x.size)
    corner = (np.arange(len(x) - 1)[:, None] * len(y) + np.arange(len(y) - 1)).ravel()
    halves = [corner, corner + len(y), corner + 1], [corner + 1, corner + len(y), corner + len(y) + 1]
    triangles = np.concatenate([np.stack(half, axis=1) for half in halves]).astype(np.int32)
    modes = np.zeros((len(vertices), 3, len(centre_m)))
    for k, place in enumerate(centre_m):
        modes[:, 2, k] = np.exp(-((vertices[:, 0] - place) ** 2 + vertices[:, 1] ** 2) / width_m**2)
    return CollisionSurface(TriangleMesh(vertices, triangles), modes, np.ones(len(centre_m)), HALF_M)


@pytest.mark.parametrize("rises_um", [2, 4, 8])
def test_a_jaw_at_rest_sees_a_wall_that_bulges_between_the_points_on_which_it_rests(rises_um):
    """Within a tenth of a millimetre: no walk over the wall leads from one bulge to the next.

    Before, within half of what a search sees beyond a contact's reach.
    """
    surface = bulging_patch([-0.8e-3, 0.4e-3], 0.4e-3)
    detector, unseen_m = tool_detector(surface), 0.0
    height = 0.6e-3 + JAW_M + HALF_M
    jaw = one_jaw([-15e-3, 0.0, height], [15e-3, 0.0, height])
    for rise in np.arange(0.0, 0.95e-3, 1e-6 * rises_um):
        surface.update(np.array([0.6e-3, rise]))
        found = detect(detector, jaw)
        deepest = height - deformed(surface)[:, 2].max() - JAW_M - HALF_M
        unseen_m = max(unseen_m, min(row["gap_m"] for row in found) - deepest)
    assert unseen_m < 0.1e-3 + 2e-6 * rises_um


def test_a_jaw_in_the_mouth_and_one_outside_pinch_the_wall(duct):
    detector = tool_detector(duct)
    for opening in np.linspace(0.5, 0.1, 60):
        duct.update(np.zeros(0))
        tool = forceps([50e-3, RADIUS_M, 0.0], [150e-3, RADIUS_M, 0.0], opening)
        found = detect(detector, tool)
    inner = [r for r in found if r["tool_segment"] in (JAW_A, JAW_B) and r["normal"][1] < -0.9]
    outer = [r for r in found if r["tool_segment"] in (JAW_A, JAW_B) and r["normal"][1] > 0.9]
    assert inner
    assert outer
    assert len({int(r["tool_segment"]) for r in inner} & {int(r["tool_segment"]) for r in outer}) == 0


@pytest.mark.parametrize(("speed_m_s", "most"), [(0.04, 12), (0.2, 48)])
def test_the_shaft_touches_too_and_a_sliding_shaft_keeps_its_points(duct, speed_m_s, most):
    """A slow one few, one that slides fast also what it will meet: here all of it is in the wall."""
    detector = tool_detector(duct)
    y = RADIUS_M + HALF_M + SHAFT_M - 0.2e-3
    for x in np.arange(60e-3, 70e-3, 1e-3 * speed_m_s):
        duct.update(np.zeros(0))
        found = detect(detector, np.array([[[[-0.1, y, 0.0], [x, y, 0.0]], AWAY, AWAY]]))
        assert all(row["tool_segment"] == SHAFT for row in found)
        assert 5 <= len(found) <= most
        gaps = np.array([float(row["gap_m"]) for row in found])
        assert gaps.min() == pytest.approx(-0.2e-3, abs=1e-6)
        assert (gaps < -0.15e-3).sum() >= 5


@pytest.mark.parametrize(
    ("steps_um", "few"), [((0, 90), True), ((70, -70), True), ((60, 30, 0), True), ((60, 60), False), ((0, 120), False)]
)
def test_a_slow_hand_told_of_by_counts_or_in_every_other_tick_is_slow(duct, steps_um, few):
    """What a shaft will meet by going on counts for one that goes on, or has gone far."""
    detector, y, x, counts = tool_detector(duct), RADIUS_M + HALF_M + SHAFT_M - 0.2e-3, 60e-3, []
    for step_um in steps_um * 20:
        x += 1e-6 * step_um
        duct.update(np.zeros(0))
        counts.append(len(detect(detector, np.array([[[[-0.1, y, 0.0], [x, y, 0.0]], AWAY, AWAY]]))))
    assert (max(counts[2:]) <= 12) == few


def test_who_takes_tools_up_again_searches_only_for_those_that_have_gone_far(duct):
    """A jaw on the wall, a little further along it, and in the lumen: where it gets to without crossing the wall."""
    y, searched = RADIUS_M + HALF_M + JAW_M - 0.2e-3, []
    detector = tool_detector(duct)
    for start, height in ((20e-3, y), (20.08e-3, y), (20.08e-3, 0.0)):
        jaw = one_jaw([start, height, 0.0], [start + 10e-3, height, 0.0])
        detector.take_up(jaw, RADII)
        duct.update(np.zeros(0))
        before = duct.shell.body.searches
        detect(detector, jaw)
        detector.stand_still()
        found = detect(detector, jaw)
        searched.append(duct.shell.body.searches - before)
        fresh = detect(tool_detector(duct), jaw)
        assert len(found) == len(fresh) > 0 or height == 0.0
        assert {tuple(row["normal"].round(3)) for row in found} == {tuple(row["normal"].round(3)) for row in fresh}
    assert searched[0] > searched[2] > searched[1] == 0


def test_an_absent_tool_touches_nothing_and_comes_back_fresh(duct):
    detector = tool_detector(duct, n_tools=2)
    inside = one_jaw([10e-3, 0.0, 0.0], [20e-3, 0.0, 0.0])[0]
    touching = one_jaw([10e-3, 5.2e-3, 0.0], [20e-3, 5.2e-3, 0.0])[0]
    both = detect(detector, np.array([touching, touching]))
    assert {int(row["tool"]) for row in both} == {0, 1}
    one = detect(detector, np.array([touching, touching]), present=np.array([True, False]))
    assert {int(row["tool"]) for row in one} == {0}
    detect(detector, np.array([touching, inside]))
    back = detect(detector, np.array([touching, touching]))
    assert min(row["gap_m"] for row in back if row["tool"] == 0) == pytest.approx(-0.05e-3, abs=0.02e-3)


@pytest.mark.parametrize("speed_m_s", [0.05, 1.0, 2.5])
def test_no_catheter_passes_through_a_jaw(duct, speed_m_s):
    """Crossed bars pushed through each other: the normal stays that of the side they came from."""
    detector = tool_detector(duct, 6)
    catheter = np.stack([np.linspace(90e-3, 100e-3, 6), np.zeros(6), np.zeros(6)], axis=1)
    for y in np.arange(5e-3, -1.5e-3, -speed_m_s * 1e-3):
        found = detect(detector, one_jaw([95.3e-3, y, -7e-3], [95.3e-3, y, 7e-3]), catheter)
        for row in found:
            assert row["target_kind"] == CATHETER_SEGMENT
            assert row["normal"][1] == pytest.approx(1.0)
            assert row["gap_m"] == pytest.approx(y - JAW_M - CATHETER_M, abs=1e-12)
    assert len(found) == 1


def test_a_catheter_that_slipped_through_the_jaw_that_held_it_is_beyond_it_when_that_lets_go(duct):
    detector = tool_detector(duct, 6)
    catheter = np.stack([np.linspace(90e-3, 100e-3, 6), np.zeros(6), np.zeros(6)], axis=1)
    for y in np.arange(1.5e-3, -1.4e-3, -0.2e-3):
        detector.let_through(0)
        (held,) = detect(detector, one_jaw([95.3e-3, y, -7e-3], [95.3e-3, y, 7e-3]), catheter)
        assert held["gap_m"] == pytest.approx(abs(y) - JAW_M - CATHETER_M, abs=1e-12)
    (row,) = detect(detector, one_jaw([95.3e-3, y, -7e-3], [95.3e-3, y, 7e-3]), catheter)
    assert row["normal"][1] == pytest.approx(-1.0)
    assert row["gap_m"] == pytest.approx(-y - JAW_M - CATHETER_M, abs=1e-12)
    for back in np.arange(y, 1.0e-3, 0.2e-3):  # and from there it does not pass
        (row,) = detect(detector, one_jaw([95.3e-3, back, -7e-3], [95.3e-3, back, 7e-3]), catheter)
        assert row["normal"][1] == pytest.approx(-1.0)


def test_the_shaft_and_the_other_tool_go_on_knowing_their_side(duct):
    detector = tool_detector(duct, 6, n_tools=2)
    catheter = np.stack([np.linspace(90e-3, 100e-3, 6), np.zeros(6), np.zeros(6)], axis=1)
    for y in np.arange(1.5e-3, -0.5e-3, -0.2e-3):
        detector.let_through(0)
        shaft, jaw = ([[x, y, -7e-3], [x, y, 7e-3]] for x in (91.3e-3, 97.3e-3))
        found = detect(detector, np.array([[shaft, AWAY, AWAY], [AWAY, jaw, AWAY]]), catheter)
    assert {int(row["tool"]) for row in found} == {0, 1}
    assert all(row["normal"][1] == pytest.approx(1.0) for row in found)


def test_a_catheter_may_go_around_the_tip_of_a_jaw(duct):
    detector = tool_detector(duct, 2)
    catheter = np.array([[100e-3, 0.0, 0.0], [110e-3, 0.0, 0.0]])
    radius = JAW_M + CATHETER_M + 0.1e-3
    for angle in np.linspace(-0.5 * np.pi, 1.5 * np.pi, 200):
        tip = np.array([105e-3, radius * np.cos(angle), radius * np.sin(angle)])
        found = detect(detector, one_jaw(tip * [1, 10, 10], tip), catheter)
        assert found[0]["gap_m"] == pytest.approx(0.1e-3, abs=1e-9)


def test_a_catheter_along_a_jaw_is_carried_by_spread_points(duct):
    detector = tool_detector(duct, 51)
    catheter = np.stack([np.linspace(60e-3, 160e-3, 51), np.zeros(51), np.zeros(51)], axis=1)
    found = detect(detector, one_jaw([80e-3, 1.75e-3, 0.0], [95e-3, 1.75e-3, 0.0]), catheter)
    assert 4 <= len(found) <= 6
    assert np.ptp([row["tool_parameter"] for row in found]) > 0.7


def test_full_arrays_keep_the_deepest_and_count_the_rest(duct):
    detector = tool_detector(duct)
    jaw = one_jaw([10e-3, 5.3e-3, 0.0], [25e-3, 4.9e-3, 0.0])
    everything = sorted(detect(detector, jaw), key=lambda row: row["gap_m"])
    pairs = ContactPairs.allocate(2)
    detector.detect(jaw, RADII, NO_CATHETER, pairs)
    assert (pairs.count, pairs.dropped) == (2, len(everything) - 2)
    assert sorted(pairs.gap_m) == pytest.approx([float(row["gap_m"]) for row in everything[:2]])


def test_a_tick_allocates_nothing(duct):
    """Numba kernels cannot (they are compiled without its runtime); neither does the Python around them."""
    tools, catheter = tool_detector(duct, 51), CatheterContactDetector(duct, 51, CATHETER_M, MARGIN_M)
    particles = np.stack([np.linspace(10e-3, 60e-3, 51), np.full(51, -2.9e-3), np.zeros(51)], axis=1)
    segments, pairs = one_jaw([10e-3, 5.2e-3, 0.0], [25e-3, 5.2e-3, 0.0]), ContactPairs.allocate(96)
    q = np.zeros(0)

    def tick():
        pairs.clear()
        duct.update(q)
        tools.detect(segments, RADII, particles, pairs)
        catheter.detect(particles, pairs)

    for _ in range(3):
        tick()
    tracemalloc.start()
    tick()
    before, _ = tracemalloc.get_traced_memory()
    tracemalloc.reset_peak()
    for _ in range(100):
        tick()
    after, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert pairs.count > 10
    # A few interned integers come and go; an array of all particles or of one mode shape would be seen.
    assert after - before < 4000
    assert peak - before < 4000
