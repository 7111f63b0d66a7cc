"""No node moves further than its bound says, and bounds are not so wide that lists would be renewed for nothing."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.mechanics.collision.wall_cases import coordinates, placed, wall
from trocar.services.mechanics.collision.placed_wall import NO_LOADS
from trocar.services.mechanics.collision.wall_bounds import WallBounds, bound_motion, set_reference, wall_bounds
from trocar.services.mechanics.compiled import building_kernel
from trocar.services.mechanics.compiled.struct import reader

bounds_at = reader(WallBounds)


@building_kernel
def moved_m(address, q):
    return bound_motion(bounds_at(address), q, 0.0)


@building_kernel
def count_from(address, q):
    set_reference(bounds_at(address), q)


@pytest.mark.parametrize("kind", ["straight", "turned"])
@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), way_mm=st.floats(0.01, 20.0), from_mm=st.floats(0.0, 20.0))
def test_no_node_moves_further_than_the_bound(kind, seed, way_mm, from_mm):
    """From any shape, one mode alone as well as all at once, as far as half a radius and more."""
    duct, rng = wall(kind), np.random.default_rng(seed)
    start = coordinates(duct, rng, 1e-3 * from_mm) if from_mm > 0.0 else np.zeros(duct.basis.n_modes)
    step = coordinates(duct, rng, 1e-3 * way_mm)
    if seed % 2:
        step *= np.arange(len(step)) == seed % len(step)
    bounds = wall_bounds(duct)
    count_from(bounds.address, start)
    moved = placed(duct, start + step, NO_LOADS) - placed(duct, start, NO_LOADS)
    furthest_m = np.linalg.norm(moved, axis=1).max()
    assert furthest_m <= moved_m(bounds.address, start + step) * (1.0 + 1e-9)
    assert moved_m(bounds.address, start) == 0.0


@pytest.mark.parametrize(("kind", "most"), [("straight", 4.0), ("turned", 12.0)])
def test_bounds_are_of_the_size_of_what_moves(kind, most):
    duct, rng, ratios = wall(kind), np.random.default_rng(1), []
    bounds, rest = wall_bounds(duct), placed(wall(kind), np.zeros(wall(kind).basis.n_modes), NO_LOADS)
    for _ in range(20):
        q = coordinates(duct, rng, 0.3e-3)
        ratios.append(moved_m(bounds.address, q) / np.linalg.norm(placed(duct, q, NO_LOADS) - rest, axis=1).max())
    assert np.median(ratios) < most
