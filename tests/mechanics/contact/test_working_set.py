"""The working set: one merge rule, whatever the order of candidates, and members come first."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays
from trocar.services.mechanics.collision.candidate_list import TOUCHING_M, CandidateList, new_list, set_wanted_gaps
from trocar.services.mechanics.collision.candidates import SAME_POINT, Candidates, candidates_at
from trocar.services.mechanics.collision.clusters import cluster_triangles
from trocar.services.mechanics.compiled import building_kernel
from trocar.services.mechanics.compiled.struct import reader
from trocar.services.mechanics.contact.geometry import ContactGeometry, RodGeometry, WallGeometry, geometry_at
from trocar.services.mechanics.contact.rolling import follow_rolling
from trocar.services.mechanics.contact.spheres import no_spheres
from trocar.services.mechanics.contact.working_set import (
    IMPLIED_M,
    LIFE_STEPS,
    MAX_CHOSEN,
    N_TOOL_PIECES,
    SAME_NORMAL,
    WorkingSet,
    age_members,
    choose,
    merge_distance_m,
    renew_member,
)
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct

MESH = parametric_duct(DuctGeometry(4e-3, 10e-3, 12, 8))
N_PIECES, WALL_M = 10, 1e-3
CORNER = (1.0, 0.0, 0.0)
THICKNESS_M = np.linspace(1e-3, 3e-3, N_PIECES)


def tools_alone():
    """Return the geometry of two tools with jaws that open along z, and squeeze nothing."""
    tools = ToolArrays.zeros(wall_thickness=WALL_M)
    tools.present[:], tools.radius[:], tools.segments[:, :, 1, 0] = True, 1e-3, 10e-3
    tools.frame[:] = np.eye(3)[[2, 1, 0]]
    rod = RodGeometry.zeros(n=2)
    wall = WallGeometry(vertices=MESH.vertices_m, triangles=MESH.triangles, half_thickness=0.5 * WALL_M)
    return ContactGeometry(tools=tools, rod=rod, wall=wall, spheres=no_spheres())


list_at, set_at = reader(CandidateList), reader(WorkingSet)


@building_kernel
def _choose(addresses, ahead_m, geometry, capacity):
    given = list_at(addresses[0]), candidates_at(addresses[1]), set_at(addresses[2])
    choose(given, ahead_m, geometry_at(geometry).tools, capacity)


@building_kernel
def _follow(found, working, start, corner):
    follow_rolling(candidates_at(found), set_at(working), start, corner)


@building_kernel
def _want(address, start, ahead_m, wall_moved_m):
    set_wanted_gaps(list_at(address), start, ahead_m, wall_moved_m)


class Chooser:
    """Candidates of pieces with the triangles of a small tube, and a working set for them."""

    def __init__(self):
        clusters = cluster_triangles(MESH.vertices_m, MESH.triangles)
        self.list = new_list(clusters, MESH.vertices_m.copy(), N_PIECES, TOUCHING_M)
        self.found = Candidates.zeros(c=512)
        self.ahead_m = np.full(N_PIECES, np.inf)
        self.geometry, self.capacity = tools_alone(), 256
        sizes = {"p": N_PIECES, "m": len(MESH.triangles), "c": 512}
        self.set = WorkingSet.zeros(rest=MESH.vertices_m, first_sphere=N_PIECES, **sizes)
        self.list.thickness[:], self.list.wanted[:] = THICKNESS_M, np.inf

    def choose(self, candidates):
        """Return which of the candidates, (piece, triangle, weights, normal, gap) each, are chosen, nearest first."""
        found = self.found
        found.count = len(candidates)
        for k, (piece, triangle, weight, normal, gap_m) in enumerate(candidates):
            found.piece[k], found.triangle[k], found.gap_m[k] = piece, triangle, gap_m
            found.weight[k], found.normal[k] = weight, normal
        addresses = self.list.address, found.address, self.set.address
        _choose(addresses, self.ahead_m, self.geometry.address, self.capacity)
        return self.set.chosen[: self.set.n_chosen].tolist()


def random_candidates(rng, n):
    """Return candidates near each other: neighbouring triangles, normals alike and not, gaps about zero."""
    triangles = rng.choice(40, n)
    normals = rng.normal((0.0, 0.0, 3.0), 1.0, (n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    gaps_m = rng.choice([1e-6, 30e-6, 0.1e-3, 0.4e-3]) * rng.normal(size=n)
    return list(
        zip(
            rng.integers(0, N_PIECES, n).tolist(), triangles, rng.dirichlet(np.ones(3), n), normals, gaps_m, strict=True
        )
    )


def place(candidate):
    return candidate[2] @ MESH.vertices_m[MESH.triangles[candidate[1]]]


def is_one_body(p, q):
    return p == q or (min(p, q) >= N_TOOL_PIECES and abs(p - q) == 1)


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 60), n_members=st.integers(0, 20))
def test_who_is_left_out_is_stood_for_by_one_nearby_that_is_nearer(seed, n, n_members):
    """No candidate is merged with one that is less deep, no member but with itself; or nearer ones fill the set."""
    rng, chooser = np.random.default_rng(seed), Chooser()
    candidates = random_candidates(rng, n)
    for k in rng.choice(n, min(n, n_members), replace=False):
        renew_member(chooser.set, *candidates[k][:2], tuple(candidates[k][2]))
    is_member = [is_nearest_to_a_member(chooser.set, candidates, k) for k in range(n)]
    chosen = chooser.choose(candidates)
    rank = {k: (not is_member[k], candidates[k][4]) for k in range(n)}
    assert [rank[k] for k in chosen] == sorted(rank[k] for k in chosen)

    def merge_m(k):
        return (2.0 * SAME_POINT if is_member[k] else 1.0) * merge_distance_m(THICKNESS_M[candidates[k][0]], WALL_M)

    def stands_for(one, k):
        is_alike = candidates[one][3] @ candidates[k][3] >= SAME_NORMAL
        is_alike &= candidates[k][4] >= candidates[one][4] - IMPLIED_M
        apart_m = np.linalg.norm(place(candidates[one]) - place(candidates[k]))
        return is_one_body(candidates[one][0], candidates[k][0]) and is_alike and apart_m < merge_m(k)

    for k in range(n):
        if k in chosen:
            assert not any(stands_for(one, k) for one in chosen[: chosen.index(k)])
        else:
            is_too_many = len(chosen) == MAX_CHOSEN and all(rank[one] <= rank[k] for one in chosen)
            assert is_too_many or any(stands_for(one, k) and rank[one] <= rank[k] for one in chosen)


@pytest.mark.parametrize(
    ("piece_um", "wall_um", "rows_up_to_um"),
    [(0.0, 0.0, 3.0), (5.0, 0.0, 8.0), (0.0, 10.0, 13.0), (20.0, 50.0, 33.0), (1500.0, 0.0, 33.0)],
)
def test_rows_are_made_for_what_would_touch_if_all_moved_on(piece_um, wall_um, rows_up_to_um):
    """At rest for a tenth of what counts as touching only; candidates are looked for as far as a piece has moved."""
    chooser, gaps_um = Chooser(), np.arange(0.5, 60.0)
    chooser.ahead_m[:] = IMPLIED_M
    start = chooser.list.ends + np.array([0.0, 1e-6 * piece_um, 0.0])
    _want(chooser.list.address, start, chooser.ahead_m, 1e-6 * wall_um)
    assert chooser.list.wanted == pytest.approx(IMPLIED_M + max(1e-6 * piece_um, 1e-6 * (rows_up_to_um - 3.0)))
    far = 3 * np.arange(len(gaps_um))
    candidates = [one(piece=k % 6, triangle=int(t), gap_m=1e-6 * gaps_um[k]) for k, t in enumerate(far)]
    assert len(chooser.choose(candidates)) == min((gaps_um < rows_up_to_um).sum(), MAX_CHOSEN)


@pytest.mark.parametrize("n_members", [0, 10, 40])
def test_all_members_have_rows_and_the_nearest_others_while_these_are_few(n_members):
    chooser, far = Chooser(), 3 * np.arange(50)
    candidates = [one(piece=k % 6, triangle=int(t), gap_m=1e-6 * k) for k, t in enumerate(far)]
    for k in range(50 - n_members, 50):
        renew_member(chooser.set, *candidates[k][:2], CORNER)
    others = max(MAX_CHOSEN - n_members, 0)
    assert chooser.choose(candidates) == [*range(50 - n_members, 50), *range(others)]


def test_members_leave_a_quarter_of_the_table_to_what_comes_later():
    """A table that was full with members had no room for the rows of effects: they were dropped."""
    chooser = Chooser()
    chooser.capacity = 48
    candidates = [one(piece=k % 6, triangle=3 * k, gap_m=1e-6 * k) for k in range(50)]
    for candidate in candidates:
        renew_member(chooser.set, *candidate[:2], CORNER)
    assert chooser.choose(candidates) == [*range(36)]


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(2, 80))
def test_the_order_in_which_candidates_come_changes_nothing(seed, n):
    rng = np.random.default_rng(seed)
    candidates, order = random_candidates(rng, n), rng.permutation(n)
    first = Chooser().choose(candidates)
    other = Chooser().choose([candidates[k] for k in order])
    assert first == [order[k] for k in other]


def one(piece=7, triangle=3, gap_m=0.0, weight=(1.0, 0.0, 0.0)):
    return piece, triangle, np.array(weight), np.array([0.0, 0.0, 1.0]), gap_m


def test_what_is_further_than_the_row_gap_gets_no_row():
    chooser = Chooser()
    chooser.ahead_m[:] = 0.5e-3
    assert chooser.choose([one(gap_m=0.6e-3), one(piece=2, gap_m=0.4e-3)]) == [1]


@pytest.mark.parametrize(("dt_s", "life"), [(5e-3, LIFE_STEPS), (1e-3, LIFE_STEPS), (0.25e-3, 12), (0.125e-3, 24)])
def test_a_member_comes_first_until_its_life_is_over(dt_s, life):
    chooser = Chooser()
    beside = (0.9, 0.1, 0.0)  # 80 um off
    both = [one(gap_m=-50e-6), one(gap_m=0.1e-3, weight=beside)]
    assert chooser.choose(both) == [0]
    both[1] = one(triangle=chooser_neighbour(3), gap_m=0.1e-3, weight=(1.0, 0.0, 0.0))
    renew_member(chooser.set, 7, both[1][1], CORNER)
    for step in range(life + 1):
        expected = 1 if step < life else 0
        assert chooser.choose(both)[0] == expected
        assert chooser.set.n_members == expected
        age_members(chooser.set, dt_s)
    assert not chooser.set.places.any()


def chooser_neighbour(triangle):
    """Return a triangle whose first corner is that of ``triangle``, or else any that shares an edge with it."""
    shared = (MESH.triangles[:, 0] == MESH.triangles[triangle, 0]) & (np.arange(len(MESH.triangles)) != triangle)
    return int(np.flatnonzero(shared)[0]) if shared.any() else triangle + 1


def test_a_place_is_a_member_once_a_step_and_bearing_again_it_lives_as_long_again():
    """It may have moved on its triangle; a second place that bears in the same step is another member."""
    chooser = Chooser()
    for triangle in (3, 4):
        renew_member(chooser.set, 7, triangle, CORNER)
    age_members(chooser.set, 1e-3)
    renew_member(chooser.set, 7, 3, (0.8, 0.2, 0.0))
    assert chooser.set.n_members == 2
    assert chooser.set.life[:2].tolist() == [LIFE_STEPS, LIFE_STEPS - 1]
    assert chooser.set.weight[0].tolist() == [0.8, 0.2, 0.0]
    renew_member(chooser.set, 7, 3, (0.0, 0.0, 1.0))
    assert (chooser.set.n_members, chooser.set.places[7, 3]) == (3, 2)


@pytest.mark.parametrize(("piece", "chosen"), [(1, [0]), (7, [1, 0])])
def test_a_second_place_on_a_triangle_is_a_member_of_a_jaw_only_if_it_bears_itself(piece, chosen):
    """A jaw along a triangle bears at one end of it; the other end would double the rows. A catheter slides."""
    chooser = Chooser()
    both = [one(piece, gap_m=-1e-6), one(piece, gap_m=-2e-6, weight=(0.9, 0.1, 0.0))]
    renew_member(chooser.set, piece, 3, (0.99, 0.01, 0.0))
    assert chooser.choose(both) == chosen
    renew_member(chooser.set, piece, 3, (0.91, 0.09, 0.0))
    assert chooser.choose(both) == [1, 0]


@pytest.mark.parametrize(("piece", "follows"), [(1, True), (7, False)])
def test_a_jaw_that_rolls_presses_half_way_between_its_last_and_its_nearest_point(piece, follows):
    """Beside the middle of a facet, at the distance from the axis there; a catheter presses where it is nearest."""
    chooser, height_m = Chooser(), 2e-3
    corners = MESH.vertices_m[MESH.triangles[3]]
    across = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal = across / np.linalg.norm(across)
    nearest_w, last_w = np.array([0.5, 0.3, 0.2]), np.array([0.4, 0.2, 0.4])
    start = np.zeros((N_PIECES, 2, 3))
    start[piece] = nearest_w @ corners + height_m * normal
    renew_member(chooser.set, piece, 3, tuple(last_w))
    gap_m = height_m - THICKNESS_M[piece]
    assert chooser.choose([(piece, 3, nearest_w, normal, gap_m)]) == [0]
    _follow(chooser.found.address, chooser.set.address, (start, MESH.vertices_m), MESH.triangles)
    found, middle_w = chooser.found, 0.5 * (nearest_w + last_w)
    away_m = start[piece, 0] - (middle_w if follows else nearest_w) @ corners
    assert found.weight[0] == pytest.approx(middle_w if follows else nearest_w)
    assert found.normal[0] == pytest.approx(away_m / np.linalg.norm(away_m))
    assert found.gap_m[0] == pytest.approx(np.linalg.norm(away_m) - THICKNESS_M[piece], abs=1e-15)


def is_nearest_to_a_member(working, candidates, k):
    """Return whether a candidate is the nearest on its feature to a place that bore; of a catheter, any is."""
    feature = candidates[k][:2]
    alike = [j for j, other in enumerate(candidates) if other[:2] == feature]
    places = [
        w for w, f in zip(working.weight, working.member[: working.n_members], strict=False) if tuple(f) == feature
    ]
    if feature[0] >= N_TOOL_PIECES:
        return len(places) > 0
    return any(k == min(alike, key=lambda j: np.sum((candidates[j][2] - w) ** 2)) for w in places)


@pytest.mark.parametrize(("thickness_m", "wall_m"), [(1.5e-3, 1e-3), (3e-3, 0.2e-3), (1.05e-3, 8e-6)])
def test_between_two_merged_points_a_round_body_is_a_quarter_wall_deep_at_most(thickness_m, wall_m):
    """A circle of this radius between two points on its tangent: as deep as its arc is high."""
    apart_m = merge_distance_m(thickness_m, wall_m)
    height_m = thickness_m - np.sqrt(thickness_m**2 - (0.5 * apart_m) ** 2)
    assert height_m <= 0.26 * wall_m


def test_what_a_waiting_tool_is_in_takes_no_room_from_others():
    """Before, its candidates were the deepest of all and left no rows for what the other bodies touch."""
    chooser, rng = Chooser(), np.random.default_rng(2)
    others = [(7, t, w, normal, gap_m) for _, t, w, normal, gap_m in random_candidates(rng, 8)]
    of_tool = [(1, t, w, normal, -1e-3) for _, t, w, normal, _ in random_candidates(rng, 30)]
    alone = Chooser().choose(others)
    chooser.geometry.tools.disengaged[0] = True
    assert chooser.choose(others + of_tool) == alone
