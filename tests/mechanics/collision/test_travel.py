"""What is noted of the wall's travel bounds how far it has moved since, and trembling is no travel."""

import numpy as np
import pytest
from collision_cases import deformed, duct_mesh, random_coordinates, wavy_surface

from services.mechanics.collision.tick import ANCHOR_M


@pytest.fixture
def surface():
    return wavy_surface(duct_mesh(), np.random.default_rng(3))


def random_walk(rng, ticks):
    """Trembling by micrometres, drifting, and now and then a leap there and back."""
    q = np.zeros_like(random_coordinates(rng, 1.0))
    for tick in range(ticks):
        q = q + random_coordinates(rng, 3e-6) + (tick % 10 == 9) * random_coordinates(rng, 60e-6)
        yield q + (tick % 17 == 8) * random_coordinates(rng, 1e-3)


def test_no_node_has_moved_further_than_the_travel_since_it_was_noted(surface):
    rng = np.random.default_rng(7)
    noted, shapes = [], []
    for q in random_walk(rng, 120):
        loaded = rng.choice(surface.mesh.n_vertices, 3, replace=False).astype(np.int32)
        surface.update(q, loaded, rng.normal(size=(3, 3)) * 2e-6)
        body, shape = surface.shell.body, deformed(surface)
        for before, then in zip(noted, shapes, strict=True):
            moved_m = np.linalg.norm(shape - then, axis=1).max()
            assert moved_m <= (body.travel - before) * (1.0 + 1e-12)
        noted.append(float(body.travel_noted))
        shapes.append(shape)


def test_a_wall_that_trembles_does_not_travel(surface):
    rng = np.random.default_rng(2)
    where = random_coordinates(rng, 1e-3)
    surface.update(where)
    body = surface.shell.body
    noted = float(body.travel_noted)
    for _ in range(2000):
        surface.update(where + random_coordinates(rng, 0.3e-6))
    assert body.travel - noted <= 2.0 * ANCHOR_M


def test_from_one_side_of_the_anchor_to_the_other(surface):
    """As far from the anchor as before, but not where it was."""
    q = random_coordinates(np.random.default_rng(4), 0.3e-6)
    surface.update(np.zeros_like(q))
    surface.update(q)
    there, noted = deformed(surface), float(surface.shell.body.travel_noted)
    surface.update(-q)
    moved_m = np.linalg.norm(deformed(surface) - there, axis=1).max()
    assert 0.0 < moved_m <= surface.shell.body.travel - noted
