"""A second opinion of how much of a search's slack is used up bounds what has come nearer, and knows of trembling."""

import math

import numpy as np
import pytest
from collision_cases import deformed, distances_to_triangles, duct_mesh, random_coordinates, wavy_surface

from services.mechanics.collision import CatheterContactDetector, CollisionSurface, regions
from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.collision.regions import Near
from services.mechanics.collision.tick import motion_between

SEEN_M = 2e-3


@pytest.fixture
def surface():
    return wavy_surface(duct_mesh(n_around=48), np.random.default_rng(3))


def note(surface, near, p):
    surface.shell.body.searches += 1
    ends = (tuple(map(float, p)),) * 2
    regions.note_near(surface.shell.body, surface.shell.wall, near, 0, ends, SEEN_M)


def used(surface, near, p):
    body, ends = surface.shell.body, (tuple(map(float, p)),) * 2
    return regions.used_since(body, near, 0, ends, int(body.searches))


def test_what_shears_and_what_is_rough_is_bounded_as_well():
    """Regions that move against each other and deform little; and more shapes than are kept of a region."""
    rng, mesh = np.random.default_rng(2), duct_mesh(n_around=48)
    shear = np.zeros((mesh.n_vertices, 3, 1))
    shear[:, 1, 0] = mesh.vertices_m[:, 0] / 10e-3 - 1.01
    rough = rng.normal(size=(mesh.n_vertices, 3, 40))
    for modes in (shear, rough):
        surface = CollisionSurface(mesh, modes, np.ones(modes.shape[2]), 0.25e-3)
        body, near = surface.shell.body, Near.allocate(1, modes.shape[2])
        for _ in range(60):
            p = rng.uniform([0.0, -4e-3, -4e-3], [40e-3, 4e-3, 4e-3])
            q = np.zeros(modes.shape[2])
            surface.update(q)
            note(surface, near, p)
            before = distances_to_triangles(p, deformed(surface), mesh.triangles)
            vertex = mesh.triangles[np.where(before > SEEN_M, before, np.inf).argmin()][0]
            way = p - deformed(surface)[vertex]
            gradient = way @ body.Phi[vertex]
            q = 0.9 * np.linalg.norm(way) * gradient / np.linalg.norm(body.Phi[vertex] @ gradient)
            surface.update(q)
            p = p + body.regions.shape[near.region[0, 0], :3] @ q  # as the wall next to it
            left = SEEN_M - used(surface, near, p)
            unseen = distances_to_triangles(p, deformed(surface), mesh.triangles)[before > SEEN_M]
            assert unseen.min() >= left - 1e-12


def towards(surface, near, vertex, direction, motion_m):
    """Modal coordinates that move a vertex so and not the middle of the closest region, which the probe goes by."""
    body = surface.shell.body
    rows = np.concatenate([direction[None] @ body.Phi[vertex], body.regions.shape[near.region[0, 0], :3]])
    return np.linalg.lstsq(rows, np.array([motion_m, 0.0, 0.0, 0.0]), rcond=None)[0]


@pytest.mark.parametrize("what", ["probe", "residual", "forgotten residual", "modes", "far modes", "all"])
def test_nothing_that_was_not_seen_has_come_nearer_than_what_is_left(surface, what):
    """Whatever of all that was not seen was closest comes as straight as it can."""
    rng, body, triangles = np.random.default_rng(5), surface.shell.body, surface.mesh.triangles
    near = Near.allocate(1, len(body.q))
    for _ in range(60):
        q, p = random_coordinates(rng, 0.5e-3), rng.uniform([0.0, -4e-3, -4e-3], [40e-3, 4e-3, 4e-3])
        surface.update(q)
        before = distances_to_triangles(p, deformed(surface), triangles)
        beyond = SEEN_M + (regions.SEARCH_MARGIN_M if what == "far modes" else 0.0)
        vertex = triangles[np.where(before > beyond, before, np.inf).argmin()][0]
        way = p - deformed(surface)[vertex]
        motion_m, direction = 0.9 * np.linalg.norm(way), way / np.linalg.norm(way)
        node, moved = np.array([vertex], np.int32), direction[None] * motion_m
        if what == "forgotten residual":
            surface.update(q, node, -moved)
            before = distances_to_triangles(p, deformed(surface), triangles)
        note(surface, near, p)
        if what in ("modes", "far modes", "all"):
            q = q + towards(surface, near, vertex, direction, motion_m)
        if what in ("probe", "all"):
            p = p - direction * motion_m
        surface.update(q, *((node, moved) if what in ("residual", "all") else ()))
        left = SEEN_M - used(surface, near, p)
        unseen = distances_to_triangles(p, deformed(surface), triangles)[before > SEEN_M]
        assert unseen.min() >= left - 1e-12
    assert body.searches == 60


def test_a_wall_and_a_probe_that_swing_together_use_up_little(surface):
    """What the sum of all motion says of a tremor of 0.2 mm is its whole way."""
    body, near = surface.shell.body, Near.allocate(1, len(surface.shell.body.q))
    swing = random_coordinates(np.random.default_rng(8), 0.2e-3)
    p = np.array([20e-3, 1e-3, 0.0])
    surface.update(np.zeros_like(swing))
    note(surface, near, p)
    noted, most, way = float(body.travel_noted), 0.0, 0.0
    for k in range(400):
        surface.update(swing * math.sin(0.06 * k))
        moved = regions_middle(surface, near)
        most = max(most, used(surface, near, p + moved))
        way = float(body.travel) - noted
    assert most < 0.1 * way


def regions_middle(surface, near):
    return surface.shell.body.regions.shape[near.region[0, 0], :3] @ surface.shell.body.q


def test_the_bound_of_all_motion_is_one_and_no_worse_than_the_energy_says(surface):
    rng, body = np.random.default_rng(11), surface.shell.body
    ratios = []
    for _ in range(50):
        q, other = random_coordinates(rng, 1e-3), random_coordinates(rng, 1e-3)
        q[rng.integers(len(q)) :] *= rng.uniform(0.0, 1.0)
        moved_m = np.linalg.norm(body.Phi @ (q - other), axis=1).max()
        energy = np.linalg.norm(body.omega * (q - other))
        bound, away = motion_between(body, q, other)
        assert away == pytest.approx(energy, rel=1e-12)
        assert moved_m <= bound * (1.0 + 1e-12)
        assert bound <= body.largest_reach * energy * (1.0 + 1e-12)
        ratios.append(bound / (body.largest_reach * energy))
    assert min(ratios) < 0.95


def test_a_probe_that_was_forgotten_has_no_opinion(surface):
    near = Near.allocate(1, len(surface.shell.body.q))
    surface.update(np.zeros(len(surface.shell.body.q)))
    note(surface, near, (20e-3, 0.0, 0.0))
    assert used(surface, near, (20e-3, 0.0, 0.0)) <= 0.0 + 1e-15
    surface.shell.body.searches += 1  # a search of its own that was not noted
    assert used(surface, near, (20e-3, 0.0, 0.0)) == math.inf


def test_a_hand_that_trembles_makes_nobody_search(surface):
    """Particles along the wall while it swings by 0.1 mm ten times a second, with noise of 2 um, for two seconds."""
    rng, body = np.random.default_rng(1), surface.shell.body
    swing, noise = random_coordinates(rng, 0.1e-3), 2e-6
    places = np.stack([np.linspace(5e-3, 35e-3, 16), np.full(16, 3e-3), np.zeros(16)], axis=1)
    detector, pairs = CatheterContactDetector(surface, 16, 0.5e-3, 0.2e-3), ContactPairs.allocate(256)
    searches = []
    for k in range(2000):
        surface.update(swing * math.sin(2.0 * math.pi * 10.0 * 1e-3 * k) + random_coordinates(rng, noise))
        pairs.clear()
        before = int(body.searches)
        detector.detect(places, pairs)
        searches.append(int(body.searches) - before)
    assert sum(searches[10:]) < 40  # it was one in every second tick
