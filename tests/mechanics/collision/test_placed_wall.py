"""Nodes are placed where modes and residual say, by all ways in which a residual is kept."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.mechanics.collision.wall_cases import (
    KINDS,
    N_MODES,
    coordinates,
    follow,
    place,
    placed,
    set_configuration,
    wall,
)
from trocar.services.mechanics.bodies.duct import DuctBody
from trocar.services.mechanics.collision.candidate_list import LOOK_AHEAD_M
from trocar.services.mechanics.collision.placed_wall import NO_LOADS, bound_since, place_wall, tightened_m
from trocar.services.mechanics.reduction import Newmark, Residual
from trocar.services.mechanics.reduction.residual.cached_rows import CachedRows

CLOSE_M = 2e-9  # blocks are float32: 1e-6 of a dent of a millimetre


@cache
def placement_of(kind):
    return place_wall(wall(kind))


def random_loads(rng, n_nodes, most=8, force_n=0.05):
    count = int(rng.integers(0, most + 1))
    return rng.choice(n_nodes, count, replace=False).astype(np.int32), rng.normal(size=(count, 3)) * force_n


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_nodes_are_where_all_modes_and_all_loads_put_them(kind, seed):
    """A few nodes at a time, lasting loads beside those of contacts; the others stay where they were placed before."""
    duct, rng = wall(kind), np.random.default_rng(seed)
    placement, before = placement_of(kind), duct.mesh.vertices_m.copy()
    set_configuration(placement, np.zeros(N_MODES), NO_LOADS)
    place(placement)
    for _ in range(4):
        nodes = np.sort(rng.choice(duct.mesh.n_vertices, int(rng.integers(1, 60)), replace=False)).astype(np.int32)
        q = coordinates(duct, rng, 3e-3)
        loads, lasting = (random_loads(rng, duct.mesh.n_vertices) for _ in range(2))
        both = np.concatenate([loads[0], lasting[0]]), np.concatenate([loads[1], lasting[1]])
        expected = before.copy()
        expected[nodes] = placed(duct, q, both)[nodes]
        set_configuration(placement, q, loads, lasting)
        place(placement, nodes)
        np.testing.assert_allclose(placement.position, expected, atol=CLOSE_M)
        before = placement.position.copy()


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1), step_m=st.sampled_from([0.0, 1e-6, 1e-3]))
def test_no_node_is_farther_from_where_the_wall_stood_than_it_says(kind, seed, step_m):
    duct, rng = wall(kind), np.random.default_rng(seed)
    placement, n = placement_of(kind), duct.mesh.n_vertices
    q, loads = coordinates(duct, rng, 3e-3), random_loads(rng, n)
    set_configuration(placement, q, loads)
    for _ in range(4):
        before = placed(duct, q, loads)
        q = q + step_m * coordinates(duct, rng, 1.0)
        loads = (loads[0], loads[1] * rng.uniform(0.5, 1.5)) if rng.integers(2) else random_loads(rng, n)
        most_m = set_configuration(placement, q, loads)
        moved_m = np.linalg.norm(placed(duct, q, loads) - before, axis=1).max()
        assert moved_m <= most_m + CLOSE_M
        assert most_m == 0.0 or moved_m > 0.01 * most_m, "a bound that says nothing"


def test_a_bound_that_lists_have_no_use_for_is_replaced_by_the_motion_itself():
    """Loads on a soft wall: the bound is a multiple of what any node moves by, and called for every triangle."""
    duct, rng = wall("straight"), np.random.default_rng(5)
    now, start, q = place_wall(duct), place_wall(duct), coordinates(duct, rng, 1e-3)
    set_configuration(now, q, NO_LOADS)
    assert tightened_m(now, 1.0) == 1.0, "nobody knows where the wall was"
    follow(start, now)
    loads = rng.choice(duct.mesh.n_vertices, 8, replace=False).astype(np.int32), rng.normal(size=(8, 3))
    before, after = placed(duct, q, NO_LOADS), placed(duct, q, loads)
    moved_m = np.linalg.norm(after - before, axis=1).max()
    most_m = set_configuration(now, q, loads)
    assert most_m > max(LOOK_AHEAD_M, 1.2 * moved_m)
    assert tightened_m(now, most_m) == pytest.approx(moved_m, abs=CLOSE_M)
    assert bound_since(now, start) == pytest.approx(moved_m, abs=CLOSE_M)
    nearly = loads[0], 0.999 * loads[1]
    little_m = set_configuration(now, q, nearly)
    assert tightened_m(now, little_m) == little_m < LOOK_AHEAD_M
    back_m = set_configuration(now, q, NO_LOADS)
    assert moved_m - CLOSE_M < tightened_m(now, back_m) < moved_m + little_m + CLOSE_M


def test_where_the_residual_is_cut_into_patches_the_bound_does_not_need_it_to_be_definite():
    """Blocks further than 4 mm apart count as zero, and some loads would have a negative energy."""
    duct = wall("straight")
    n, x = duct.mesh.n_vertices, duct.mesh.vertices_m
    near = np.linalg.norm(x[:, None] - x[None], axis=2) < 4e-3
    starts = np.concatenate([[0], np.cumsum(near.sum(axis=1))]).astype(np.int32)
    blocks = duct.residual.blocks.reshape(n, n, 3, 3)
    cut = replace(duct, residual=Residual.patches(starts, np.nonzero(near)[1].astype(np.int32), blocks[near]))
    R = np.where(near[:, :, None, None], blocks, 0.0).swapaxes(1, 2).reshape(3 * n, -1)
    energies, patterns = np.linalg.eigh(0.5 * (R + R.T))
    assert energies[0] < -0.01 * energies[-1]
    placement, q = place_wall(cut), np.zeros(N_MODES)
    force_n = patterns[:, 0].reshape(-1, 3)
    nodes = np.argsort(-np.linalg.norm(force_n, axis=1))[:40].astype(np.int32)
    loads = nodes, np.ascontiguousarray(force_n[nodes])
    set_configuration(placement, q, NO_LOADS)
    most_m = set_configuration(placement, q, loads)
    moved_m = np.linalg.norm(placed(cut, q, loads) - x, axis=1).max()
    assert moved_m <= most_m + CLOSE_M


@pytest.mark.parametrize("kind", KINDS)
def test_a_start_knows_what_was_placed_and_places_the_rest(kind):
    duct, rng = wall(kind), np.random.default_rng(3)
    now, n = place_wall(duct), duct.mesh.n_vertices
    start = place_wall(duct, now)
    q, loads = coordinates(duct, rng, 3e-3), random_loads(rng, n)
    set_configuration(now, q, loads)
    place(now, np.arange(0, n, 2, dtype=np.int32))
    follow(start, now)
    set_configuration(now, coordinates(duct, rng, 3e-3), random_loads(rng, n))
    place(now)
    place(start)
    assert start.n_requested == n - (n + 1) // 2
    np.testing.assert_allclose(start.position, placed(duct, q, loads), atol=CLOSE_M)


@pytest.mark.parametrize("kind", KINDS)
def test_detection_and_picture_see_the_same_wall(kind):
    duct, rng = wall(kind), np.random.default_rng(4)
    body, placement = DuctBody(duct, Newmark(duct.basis.omega_rad_s, duct.damping_ratio), 16), place_wall(duct)
    body.state.q[:] = coordinates(duct, rng, 3e-3)
    nodes, forces = rng.choice(duct.mesh.n_vertices, 8, replace=False), rng.normal(size=(8, 3)) * 0.05
    body.load_nodes[:8], body.load_force_n[:8] = nodes, forces
    body.replace_loads(8)
    set_configuration(placement, body.state.q, (body.load_nodes[:8], body.load_force_n[:8]))
    place(placement)
    assert np.abs(placement.position - body.surface_m()).max() < CLOSE_M
    alone = placement.position.copy()
    set_configuration(placement, body.state.q, NO_LOADS)
    place(placement)
    assert np.abs(placement.position - alone).max() > 0.1e-3, "loads that do nothing show nothing"


def test_with_room_for_a_few_rows_of_the_residual_loads_take_turns():
    """More loaded nodes than rows: a row that is read anew is that of its node, with all nodes that are placed."""
    duct, rng = wall("cyclic"), np.random.default_rng(7)
    duct = replace(duct, rows=CachedRows.of(duct.residual, 3))
    placement, n = place_wall(duct), duct.mesh.n_vertices
    for _ in range(12):
        nodes = np.sort(rng.choice(n, 40, replace=False)).astype(np.int32)
        loads, q = random_loads(rng, n), coordinates(duct, rng, 1e-3)
        set_configuration(placement, q, loads)
        place(placement, nodes)
        np.testing.assert_allclose(placement.position[nodes], placed(duct, q, loads)[nodes], atol=CLOSE_M)


def test_walls_of_one_duct_with_one_cache_are_where_walls_with_their_own_are():
    """To the bit, also while each takes rows from the other: a block does not depend on who reads it."""
    duct, rng = wall("cyclic"), np.random.default_rng(9)
    shared = replace(duct, rows=CachedRows.of(duct.residual, 5))
    walls, alone = [place_wall(shared), place_wall(shared)], [place_wall(duct), place_wall(duct)]
    n = duct.mesh.n_vertices
    assert walls[0].blocks is walls[1].blocks
    assert alone[0].blocks is not alone[1].blocks
    for turn in range(12):
        nodes, which = np.sort(rng.choice(n, 40, replace=False)).astype(np.int32), turn % 2
        loads, q = random_loads(rng, n), coordinates(duct, rng, 1e-3)
        for each in (walls[which], alone[which]):
            set_configuration(each, q, loads)
            place(each, nodes)
        np.testing.assert_array_equal(walls[which].position, alone[which].position)
