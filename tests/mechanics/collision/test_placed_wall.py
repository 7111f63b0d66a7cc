"""Nodes are placed where modes and residual say, by all ways in which a residual is kept."""

from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from wall_cases import KINDS, N_MODES, coordinates, placed, wall

from services.mechanics.bodies.duct import DuctBody
from services.mechanics.collision import placed_wall
from services.mechanics.collision.placed_wall import NO_LOADS, place_walls
from services.mechanics.reduction import Newmark
from services.mechanics.reduction.residual.nearby_blocks import neighbourhoods

CLOSE_M = 2e-9  # blocks are float32: 1e-6 of a dent of a millimetre


@cache
def placement_of(kind):
    return place_walls(wall(kind))


def random_loads(rng, n_nodes, most=8, force_n=0.05):
    count = int(rng.integers(0, most + 1))
    return rng.choice(n_nodes, count, replace=False).astype(np.int32), rng.normal(size=(count, 3)) * force_n


@pytest.fixture(autouse=True)
def all_rings(monkeypatch):
    """In a duct as small as these all nodes are within so many edges of each other."""
    monkeypatch.setattr(placed_wall, "MOST_RINGS", 40)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_nodes_are_where_all_modes_and_all_loads_put_them(kind, seed):
    """A few nodes at a time, lasting loads beside those of contacts; the others stay where they were placed before."""
    duct, rng = wall(kind), np.random.default_rng(seed)
    placement, before = placement_of(kind), duct.mesh.vertices_m.copy()
    placement.place(placement.every, np.zeros(N_MODES), NO_LOADS)
    for _ in range(4):
        nodes = np.sort(rng.choice(duct.mesh.n_vertices, int(rng.integers(1, 60)), replace=False)).astype(np.int32)
        q = coordinates(duct, rng, 3e-3)
        loads, lasting = (random_loads(rng, duct.mesh.n_vertices) for _ in range(2))
        both = np.concatenate([loads[0], lasting[0]]), np.concatenate([loads[1], lasting[1]])
        expected = before.copy()
        expected[nodes] = placed(duct, q, both)[nodes]
        moved_m = placement.place(nodes, q, loads, lasting)
        np.testing.assert_allclose(placement.position_m, expected, atol=CLOSE_M)
        assert moved_m == pytest.approx(np.linalg.norm(expected - before, axis=1).max(), abs=2 * CLOSE_M)
        before = placement.position_m.copy()


@pytest.mark.parametrize("kind", KINDS)
def test_detection_and_picture_see_the_same_wall(kind):
    duct, rng = wall(kind), np.random.default_rng(4)
    body, placement = DuctBody(duct, Newmark(duct.basis.omega_rad_s, duct.damping_ratio), 16), place_walls(duct)
    body.state.q[:] = coordinates(duct, rng, 3e-3)
    nodes, forces = rng.choice(duct.mesh.n_vertices, 8, replace=False), rng.normal(size=(8, 3)) * 0.05
    body.load_nodes[:8], body.load_force_n[:8] = nodes, forces
    body.replace_loads(8)
    placement.place(placement.every, body.state.q, (body.load_nodes[:8], body.load_force_n[:8]))
    assert np.abs(placement.position_m - body.surface_m()).max() < CLOSE_M
    alone = placement.position_m.copy()
    placement.place(placement.every, body.state.q, NO_LOADS)
    assert np.abs(placement.position_m - alone).max() > 0.1e-3, "loads that do nothing show nothing"


@pytest.mark.parametrize("kind", KINDS)
def test_where_there_is_room_for_a_few_rings_only_loads_end_there(kind, monkeypatch):
    duct, rings = wall(kind), 5
    n, rng = duct.mesh.n_vertices, np.random.default_rng(7)
    residual = duct.residual
    if kind != "cyclic":  # all pairs are read in place: they need no room
        starts, neighbours = neighbourhoods(duct.mesh, 12)
        blocks = residual.blocks.reshape(n, n, 3, 3)[np.repeat(np.arange(n), np.diff(starts)), neighbours]
        residual = type(residual).patches(starts, neighbours, np.ascontiguousarray(blocks))
    duct = type(duct)(duct.mesh, duct.basis, residual, duct.damping_ratio, warp=duct.warp)
    monkeypatch.setattr(placed_wall, "MOST_BLOCKS", 3 * rings * (rings + 1) * n)
    placement, node, force = place_walls(duct), np.array([200], np.int32), rng.normal(size=(1, 3)) * 0.05
    q = coordinates(duct, rng, 1e-3)
    placement.place(placement.every, q, (node, force))
    starts, ring = neighbourhoods(duct.mesh, rings)
    near = np.isin(np.arange(n), ring[starts[200] : starts[201]])
    assert 20 < near.sum() < n // 3
    assert np.abs(placement.position_m - placed(duct, q, (node, force)))[near].max() < CLOSE_M
    unloaded = placed(duct, q, NO_LOADS)
    assert np.abs(placement.position_m - unloaded)[~near].max() < CLOSE_M


def test_a_wall_that_turns_needs_to_know_how():
    with pytest.raises(ValueError, match="needs a duct with a warp"):
        placed_wall.TurnedPlacement(wall("straight"))
