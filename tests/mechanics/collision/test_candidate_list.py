"""Lists are complete: whatever moves how, the candidates are those that brute force over all triangles finds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.mechanics.collision.wall_cases import N_MODES, coordinates, placed, wall, wall_at
from trocar.services.mechanics.collision.candidate_list import (
    LOOK_AHEAD_M,
    REFERENCE_M,
    SKIN_M,
    TOUCHING_M,
    CandidateList,
    complete_lists,
    new_list,
    rebuild_due,
    select_due,
    set_wanted_gaps,
)
from trocar.services.mechanics.collision.candidate_list import REACH_M as REACHED_M
from trocar.services.mechanics.collision.candidates import Candidates, candidates_at
from trocar.services.mechanics.collision.clusters import cluster_triangles
from trocar.services.mechanics.collision.placed_wall import NO_LOADS, copy_configuration, place_wall
from trocar.services.mechanics.collision.wall_candidates import (
    candidates_of,
    follow_end,
    follow_wall,
    measure,
    wall_candidates,
)
from trocar.services.mechanics.compiled import building_kernel
from trocar.services.mechanics.compiled.struct import reader
from trocar.services.mechanics.compiled.vectors import row, row_of
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.studies.judge.closest import segment_triangle

N_PIECES, REACH_M, TICKS = 7, 0.5e-3, 12
THICKNESS_M = np.array([2.5e-3, 1.5e-3, 1.5e-3, 1e-3, 1e-3, 1e-3, 2e-3])
LENGTH_M = np.array([30e-3, 10e-3, 10e-3, 3e-3, 3e-3, 2e-3, 0.0])  # a shaft, jaws, pieces of a catheter, a stone
CLOSE_M = 5e-9
list_at = reader(CandidateList)


@building_kernel
def all_distances(ends, vertices, triangles, out):
    """Write how far pieces (p, 2, 3) are from triangles (m, 3), (p, m)."""
    for p in range(ends.shape[0]):
        a, b = row_of(ends, p, 0), row_of(ends, p, 1)
        for t in range(triangles.shape[0]):
            u, v, w = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            out[p, t] = np.sqrt(segment_triangle(a, b, row(vertices, u), row(vertices, v), row(vertices, w))[0])


def near(ends, vertices, triangles, gap_m):
    """Return what is nearer than a gap, {(piece, triangle): gap}, and the gaps of all (p, m)."""
    out = np.empty((len(ends), len(triangles)))
    all_distances(ends, vertices, triangles, out)
    gaps = out - THICKNESS_M[: len(ends), None]
    return {(int(p), int(t)): gaps[p, t] for p, t in zip(*np.nonzero(gaps <= gap_m), strict=True)}, gaps


def somewhere(rng):
    """Return the ends of pieces (p, 2, 3) about the wall: in the lumen, in the wall, outside, beyond the mouth."""
    middle = np.stack([rng.uniform(0.0, 45e-3, N_PIECES), *rng.uniform(-7e-3, 7e-3, (2, N_PIECES))], axis=1)
    along = rng.normal(size=(N_PIECES, 3))
    along *= 0.5 * LENGTH_M[:, None] / np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([middle - along, middle + along], axis=1)


def compare(wall_now, found, ends, active, gap_m, span):
    """Assert that what was found is all that is near, of active pieces in a span, with its own points and normals."""
    vertices, triangles = wall_now
    expected, gaps = near(ends, vertices, triangles, gap_m)
    expected = {k: g for k, g in expected.items() if active[k[0]] and span[0] <= k[0] < span[1]}
    n = found.count
    keys = list(zip(found.piece[:n].tolist(), found.triangle[:n].tolist(), strict=True))
    for key in set(keys) ^ set(expected):
        assert abs(gaps[key] - gap_m) < CLOSE_M, f"{key}: {gaps[key]} m, asked for {gap_m} m"
    p, t, s, w = found.piece[:n], found.triangle[:n], found.s[:n, None], found.weight[:n]
    is_closest = np.array([k == 0 or keys[k] != keys[k - 1] for k in range(n)], bool)  # other places come after it
    assert found.gap_m[:n][is_closest] == pytest.approx(gaps[p, t][is_closest], abs=CLOSE_M)
    farther_m = found.gap_m[:n] - gaps[p, t]
    assert ((farther_m > -CLOSE_M) & (farther_m < TOUCHING_M + CLOSE_M) & (found.gap_m[:n] < gap_m + CLOSE_M)).all()
    is_at_end = (s[:, 0] == 0.0) | (s[:, 0] == 1.0)
    assert ((np.min(w, axis=1) == 0.0) | is_at_end)[~is_closest].all(), "they lie on edges, or are ends"
    assert ((w >= 0.0).all() and (s >= 0.0).all() and (s <= 1.0).all()) or n == 0
    away = ends[p, 0] + s * (ends[p, 1] - ends[p, 0]) - np.einsum("kc,kci->ki", w, vertices[triangles[t]])
    apart = found.gap_m[:n] + THICKNESS_M[p]
    is_apart = apart > 1e-6
    assert away[is_apart] == pytest.approx((apart[:, None] * found.normal[:n])[is_apart], abs=CLOSE_M)
    return n


class Lists:
    """Lists of so many pieces that may want candidates up to `REACH_M`, and what is found."""

    def __init__(self, duct, n_pieces):
        self.duct, self.known = duct, wall_candidates(duct, n_pieces, TOUCHING_M)
        self.found, self.start_wall = Candidates.zeros(c=8192), place_wall(duct, self.known.wall)
        self.list.reach[:] = REACH_M

    @property
    def list(self):
        return self.known.list

    def more(self, n_pieces):
        self.known = wall_candidates(self.duct, n_pieces, TOUCHING_M, self.known)
        self.list.reach[:] = REACH_M

    def follow(self, q, loads):
        return _follow(self.known.address, self.start_wall.address, q, loads)

    def move(self, ends, q, loads):
        """Move pieces and wall, as to the end of a step; the gaps wanted there are at most those of the start."""
        start = self.list.ends.copy()
        self.list.ends[:] = ends
        addresses = self.known.address, self.start_wall.address
        _move(addresses, q, (loads, NO_LOADS), start, np.full(len(ends), REACH_M - REACHED_M))

    def measure(self):
        _measure(self.known.address, self.found.address)
        return self.found


@building_kernel
def _follow(address, start, q, loads):
    is_elsewhere = follow_wall(candidates_of(address), q, loads)
    copy_configuration(wall_at(start), candidates_of(address).wall)
    return is_elsewhere


@building_kernel
def _move(addresses, q, loads, start, ahead):
    follow_end(candidates_of(addresses[0]), q, loads, (wall_at(addresses[1]), start), ahead)


@building_kernel
def _measure(address, found):
    measure(candidates_of(address), candidates_at(found))


@pytest.mark.parametrize("kind", ["straight", "turned"])
@settings(max_examples=16)
@given(
    seed=st.integers(0, 2**32 - 1),
    piece_m=st.sampled_from([0.0, 0.02e-3, 0.2e-3, 2e-3]),
    wall_m=st.sampled_from([0.0, 0.02e-3, 0.1e-3, 1e-3]),
    dent_m=st.sampled_from([0.0, 0.05e-3, 0.4e-3]),
)
def test_whatever_moves_the_candidates_are_those_of_brute_force(kind, seed, piece_m, wall_m, dent_m):
    """Pieces come, go, creep and jump; the wall creeps and jumps; loads press on what is touched, as contacts do."""
    duct, rng = wall(kind), np.random.default_rng(seed)
    lists = Lists(duct, N_PIECES)
    lists.list.thickness[:] = THICKNESS_M
    ends, q, total = somewhere(rng), coordinates(duct, rng, 2e-3), 0
    drift, loads = rng.normal(size=(N_PIECES, 1, 3)), NO_LOADS
    for _ in range(TICKS):
        ends = ends + piece_m * (drift + 0.3 * rng.normal(size=ends.shape))
        gone_astray = rng.uniform(size=N_PIECES) < 0.03
        ends[gone_astray] = somewhere(rng)[gone_astray]
        ends[6, 1] = ends[6, 0]
        q = q + coordinates(duct, rng, 1.0) * wall_m
        active = rng.uniform(size=N_PIECES) > 0.05
        lists.list.active[:], lists.list.ends[:] = active, ends
        lists.follow(q, loads)
        for _ in range(4):  # where it begins, and where it ends, once and again, by the same lists
            wall_now = placed(duct, q, loads), duct.mesh.triangles
            gap_m = float(rng.choice([REACH_M - 0.4e-3, 0.0, -20e-6]))
            lists.list.wanted[:] = gap_m
            found = lists.measure()
            total += compare(wall_now, found, ends, active, gap_m, (0, N_PIECES))
            touched = np.unique(duct.mesh.triangles[found.triangle[: found.count]])[:12].astype(np.int32)
            push = rng.normal(size=(len(touched), 3))
            loads = touched, dent_m * push / max(softness(kind), 1e-9) / max(len(touched), 1)
            ends = ends + piece_m * rng.normal(size=(N_PIECES, 1, 3))
            q = q + coordinates(duct, rng, 1.0) * wall_m
            lists.move(ends, q, loads)
    assert found.dropped == lists.list.dropped == 0


def softness(kind):
    """Return how far a force moves its own node beyond the modes, about, in m/N."""
    duct, out = wall(kind), np.zeros((1, 3))
    duct.residual.apply(np.array([200], np.int32), np.array([[0.0, 1.0, 0.0]]), np.array([200], np.int32), out)
    return float(np.linalg.norm(out))


def test_within_all_its_reach_a_list_is_complete_where_it_was_made():
    duct, rng = wall("straight"), np.random.default_rng(2)
    lists, seen = Lists(duct, N_PIECES), 0
    lists.list.thickness[:], lists.list.active[:] = THICKNESS_M, True
    for _ in range(20):
        ends, q = somewhere(rng), coordinates(duct, rng, 2e-3)
        lists.list.ends[:] = ends
        lists.follow(q, NO_LOADS)
        lists.list.wanted[:] = REACH_M
        found = lists.measure()
        wall_now = placed(duct, q, NO_LOADS), duct.mesh.triangles
        seen += compare(wall_now, found, ends, np.ones(N_PIECES, bool), REACH_M, (0, N_PIECES))
    assert seen > 500


@pytest.mark.parametrize("tilt", [0.0, 1e-4, -1e-4])
@pytest.mark.parametrize("beyond_m", [1e-3, -0.2e-3], ids=["both edges", "an edge and its end"])
def test_a_piece_along_a_triangle_touches_it_in_two_places_whichever_is_nearer(tilt, beyond_m):
    """With the nearer one alone a jaw had no contact at the other, and sank in there until it was the nearer one."""
    duct = wall("straight")
    lists = Lists(duct, 1)
    lists.list.thickness[:], lists.list.active[:] = 1e-3, True
    corners_m = duct.mesh.vertices_m[duct.mesh.triangles[200]]
    a, b, c = corners_m
    normal = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
    on_ab, on_ac = a + 0.5 * (b - a), a + 0.5 * (c - a)
    along = (on_ac - on_ab) / np.linalg.norm(on_ac - on_ab)
    width_m = np.linalg.norm(on_ac - on_ab)
    ends = np.stack([on_ab - 1e-3 * along, on_ac + beyond_m * along]) + (1e-3 + 5e-6) * normal
    ends[1] += tilt * (width_m + 1e-3 + beyond_m) * normal
    lists.list.ends[0] = ends
    lists.follow(np.zeros(N_MODES), NO_LOADS)
    lists.list.wanted[:] = 0.1e-3
    found = lists.measure()
    mine = np.flatnonzero(found.triangle[: found.count] == 200)
    touched_m = np.einsum("kc,ci->ki", found.weight[mine], corners_m)
    for place_m in (on_ab, on_ac + min(beyond_m, 0.0) * along):
        assert np.linalg.norm(touched_m - place_m, axis=1).min() < 20e-6
    assert np.ptp(found.gap_m[mine]) <= max(abs(tilt) * width_m, 1e-9) + 1e-9


def test_a_list_is_rebuilt_when_its_skin_is_used_up_and_hardly_before():
    duct, step_m, moved_m = wall("straight"), 0.03e-3, np.zeros(2)
    lists, rest = Lists(duct, 2), np.zeros(N_MODES)
    lists.list.thickness[:], lists.list.active[:] = 1e-3, True
    lists.list.ends[:] = [[10e-3, 2e-3, 0.0], [13e-3, 2e-3, 0.0]]
    furthest = duct.basis.displacements(np.eye(N_MODES)[0])
    mode = np.eye(N_MODES)[0] / np.linalg.norm(furthest, axis=1).max()
    lists.follow(rest, NO_LOADS)
    for q_m in (*np.zeros(100), *step_m * np.arange(1, 101)):  # first a piece moves, and then the wall
        if q_m == 0.0:
            lists.list.ends[0, :, 0] += step_m
            moved_m += [step_m, 0.0]
        else:
            moved_m += step_m
        listed_m, was_m = lists.list.listed_ends.copy(), lists.list.covered_m.copy()
        lists.follow(q_m * mode, NO_LOADS)
        is_rebuilt = (lists.list.listed_ends != listed_m).any(axis=(1, 2)) | (lists.list.covered_m > was_m)
        assert (moved_m[is_rebuilt] > SKIN_M - 2.0 * (REFERENCE_M + step_m)).all()
        moved_m[is_rebuilt] = 0.0
        assert (moved_m <= SKIN_M).all()


def test_a_list_covers_the_motion_for_which_it_was_made_and_no_more():
    """A step ends twice, the second time about twice as far on the other side, with one mode and so a tight bound."""
    duct, rng, seen = wall("straight"), np.random.default_rng(6), 0
    lists, mode = Lists(duct, N_PIECES), np.eye(N_MODES)[0]
    mode /= np.linalg.norm(duct.basis.displacements(mode), axis=1).max()
    lists.list.thickness[:], lists.list.active[:] = THICKNESS_M, True
    for first_m in rng.uniform(0.5e-3, 3e-3, 40):
        lists.list.ends[:] = ends = somewhere(rng)
        lists.follow(0.0 * mode, NO_LOADS)
        for q_m in (first_m, -first_m - rng.uniform(0.0, 3e-3)):
            lists.move(ends, q_m * mode, NO_LOADS)
            lists.list.wanted[:] = 0.0
            wall_now = placed(duct, q_m * mode, NO_LOADS), duct.mesh.triangles
            seen += compare(wall_now, lists.measure(), ends, np.ones(N_PIECES, bool), 0.0, (0, N_PIECES))
    assert seen > 500


def test_lists_do_not_grow_where_a_step_is_solved_again_and_again():
    """Each price counted the wall's motion since the last one too: six in a step listed 47,756 entries, not 3,227."""
    duct, rng = wall("straight"), np.random.default_rng(4)
    lists = Lists(duct, N_PIECES)
    lists.list.thickness[:], lists.list.active[:] = THICKNESS_M, True
    lists.list.ends[:] = ends = somewhere(rng)
    lists.follow(np.zeros(N_MODES), NO_LOADS)
    far, entries = coordinates(duct, rng, 3e-3), []
    for share in (1.0, -0.9, 0.8, -0.7, 0.6, -0.5):
        lists.move(ends, share * far, NO_LOADS)
        entries.append(int(lists.list.count.sum()))
    assert max(entries) <= entries[0]


def test_a_piece_more_is_followed_as_the_others():
    duct, found = wall("straight"), Candidates.zeros(c=512)
    lists = Lists(duct, 1)
    for number in range(2):
        if number:
            lists.more(2)
        lists.list.thickness[:], lists.list.active[:] = 1e-3, True
        lists.list.ends[:] = [20e-3, 3.2e-3, 0.0]
        lists.follow(np.zeros(N_MODES), NO_LOADS)
        lists.list.wanted[:] = 0.0
        found = lists.measure()
        assert set(found.piece[: found.count].tolist()) == set(range(number + 1))


def test_after_a_wall_without_numbers_candidates_are_found_again():
    """A state that is not finite is put back, and everything forgotten: nothing of it may stay."""
    duct, found = wall("straight"), Candidates.zeros(c=2048)
    lists, rest = Lists(duct, 1), np.zeros(N_MODES)
    lists.list.thickness[:], lists.list.active[:] = THICKNESS_M[:1], True
    lists.list.ends[0] = [[10e-3, 2e-3, 0.0], [13e-3, 2e-3, 0.0]]
    for q in (rest, rest + np.nan, rest):
        lists.follow(q, NO_LOADS)
        lists.move(lists.list.ends.copy(), q, NO_LOADS)
        found = lists.measure()
    lists.known.is_new = True
    for _ in range(2):
        lists.follow(rest, NO_LOADS)
        lists.list.wanted[:] = 0.0
        found = lists.measure()
        wall_now = duct.mesh.vertices_m, duct.mesh.triangles
        assert compare(wall_now, found, lists.list.ends, np.ones(1, bool), 0.0, (0, 1)) > 0


def test_what_was_put_elsewhere_is_found_there():
    """`forget`: a wall and pieces that jump at once by more than any skin."""
    duct, found = wall("straight"), Candidates.zeros(c=2048)
    lists, rng = Lists(duct, N_PIECES), np.random.default_rng(9)
    lists.list.thickness[:], lists.list.active[:] = THICKNESS_M, True
    for _ in range(5):
        ends, q = somewhere(rng), coordinates(duct, rng, 5e-3)
        lists.list.ends[:] = ends
        lists.known.is_new = True
        lists.follow(q, NO_LOADS)
        lists.list.wanted[:] = 0.0
        found = lists.measure()
        compare((placed(duct, q, NO_LOADS), duct.mesh.triangles), found, ends, np.ones(N_PIECES, bool), 0.0, (0, 7))


@building_kernel
def _list_and_jump(address, jump_m, ahead):
    found = list_at(address)
    select_due(found, np.inf)
    rebuild_due(found)
    start, before = found.ends.copy(), found.count[0]
    found.ends[:] += jump_m
    set_wanted_gaps(found, start, ahead, 0.0)
    complete_lists(found, 0.0)
    return before, found.count[0]


def test_a_shaft_that_jumps_along_the_default_duct_has_room_for_all_it_may_touch():
    """The default scene lost 111,000 entries in five seconds of play: a shaft beside it had 2,018, and room for 768."""
    mesh = parametric_duct(DuctGeometry(4e-3, 40e-3, 72, 70))
    listed = new_list(cluster_triangles(mesh.vertices_m, mesh.triangles), mesh.vertices_m.copy(), 1, TOUCHING_M)
    listed.ends[0], listed.thickness[:], listed.active[:] = [[0.0, 0.0, 6.9e-3], [40e-3, 0.0, 6.9e-3]], 3e-3, True
    listed.reach[:] = TOUCHING_M + REACHED_M
    ordinary, fast = _list_and_jump(listed.address, np.array([0.0, 0.0, -LOOK_AHEAD_M]), np.full(1, TOUCHING_M))
    assert listed.dropped == 0
    assert 500 < ordinary < 0.5 * fast
