"""The tree finds the closest point of a deformed duct exactly, whatever it knew before."""

import numpy as np
import pytest
from collision_cases import (
    deformed,
    distance_of_hulls,
    distances_to_triangles,
    duct_mesh,
    random_coordinates,
    wavy_surface,
)

from services.mechanics.collision import CatheterContactDetector, search
from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.collision.topology import fill_rim

EVERYWHERE_M = 1.0


def closest(surface, ends, radius=EVERYWHERE_M, guess=search.NOT_FOUND):
    a, b = (tuple(map(float, end)) for end in ends)
    shell = surface.shell
    return search.closest(shell.body, shell.wall, a, b, radius, guess)


def points_about(rng, n):
    x = rng.uniform(-5e-3, 45e-3, n)
    return np.stack([x, *rng.uniform(-7e-3, 7e-3, (2, n))], axis=1)


@pytest.fixture(scope="module")
def surface():
    return wavy_surface(duct_mesh(), np.random.default_rng(3))


@pytest.mark.parametrize("deformation_m", [0.0, 1e-3, 5e-3])
def test_closest_point_equals_brute_force(surface, deformation_m):
    rng = np.random.default_rng(int(deformation_m * 1e4))
    for _ in range(3):
        loaded = rng.choice(surface.mesh.n_vertices, 5, replace=False).astype(np.int32)
        residual = rng.normal(size=(5, 3)) * 0.3 * deformation_m
        surface.update(random_coordinates(rng, deformation_m), loaded, residual)
        vertices = deformed(surface)
        for p in points_about(rng, 40):
            expected = distances_to_triangles(p, vertices, surface.mesh.triangles)
            triangle, d2, _, w = closest(surface, (p, p), guess=int(rng.integers(-1, 50)))
            assert np.sqrt(d2) == pytest.approx(expected.min(), abs=1e-12)
            assert expected[triangle] == pytest.approx(expected.min(), abs=1e-12)
            foot = np.array(w) @ vertices[surface.mesh.triangles[triangle]]
            assert np.linalg.norm(p - foot) == pytest.approx(expected.min(), abs=1e-12)


def test_the_residual_of_one_tick_is_forgotten_in_the_next(surface):
    node = np.array([100], np.int32)
    surface.update(random_coordinates(np.random.default_rng(0), 1e-3))
    plain = deformed(surface)
    surface.update(random_coordinates(np.random.default_rng(0), 1e-3), node, np.array([[1e-3, 2e-3, 3e-3]]))
    moved = deformed(surface) - plain
    assert moved[100] == pytest.approx([1e-3, 2e-3, 3e-3])
    assert np.count_nonzero(np.abs(moved).max(axis=1) > 1e-15) == 1
    surface.update(random_coordinates(np.random.default_rng(0), 1e-3))
    assert deformed(surface) == pytest.approx(plain, abs=0.0)


def test_closest_segment_equals_brute_force(surface):
    rng = np.random.default_rng(11)
    surface.update(random_coordinates(rng, 2e-3))
    vertices = deformed(surface)
    corners = vertices[surface.mesh.triangles]
    for p in points_about(rng, 25):
        ends = np.array([p, p + rng.normal(size=3) * 3e-3])
        near = np.argsort(distances_to_triangles(ends.mean(0), vertices, surface.mesh.triangles))[:60]
        expected = min(distance_of_hulls(ends, corners[k]) for k in near[:12])
        _, d2, s, _ = closest(surface, ends)
        assert np.sqrt(d2) <= expected + 1e-12
        middle = ends[0] + s * (ends[1] - ends[0])
        reached = distances_to_triangles(middle, vertices, surface.mesh.triangles).min()
        assert np.sqrt(d2) == pytest.approx(reached, abs=1e-12)


def test_nothing_is_found_outside_the_radius(surface):
    surface.update(random_coordinates(np.random.default_rng(0), 0.0))
    p = np.array([20e-3, 0.0, 12e-3])
    expected = distances_to_triangles(p, deformed(surface), surface.mesh.triangles).min()
    assert closest(surface, (p, p), radius=0.999 * expected)[0] == search.NOT_FOUND
    assert closest(surface, (p, p), radius=1.001 * expected)[0] != search.NOT_FOUND


def test_old_looks_never_hide_a_triangle_that_has_moved(surface):
    """Boxes seen ticks ago are used again: they must have grown by what the wall has moved since."""
    rng = np.random.default_rng(5)
    q = random_coordinates(rng, 2e-3)
    points = points_about(rng, 10)
    for _ in range(40):
        q = q + random_coordinates(rng, 0.3e-3)
        loaded = rng.choice(surface.mesh.n_vertices, 3, replace=False).astype(np.int32)
        surface.update(q, loaded, rng.normal(size=(3, 3)) * 0.5e-3)
        vertices = deformed(surface)
        for p in points:
            expected = distances_to_triangles(p, vertices, surface.mesh.triangles).min()
            assert np.sqrt(closest(surface, (p, p))[1]) == pytest.approx(expected, abs=1e-12)


def test_second_minimum_is_the_other_wall_of_a_collapsed_duct():
    mesh = duct_mesh()
    flattening = np.zeros((mesh.n_vertices, 3, 1))
    flattening[:, 1, 0] = -mesh.vertices_m[:, 1]
    surface = type(wavy_surface(mesh, np.random.default_rng(0)))(mesh, flattening, np.ones(1), 0.25e-3)
    surface.update(np.array([0.7]))  # a lumen 8 mm wide and 2.4 mm high
    p, shell = (20e-3, 0.3e-3, 0.0), surface.shell
    first = closest(surface, (p, p))
    assert np.sqrt(first[1]) == pytest.approx(0.9e-3, abs=0.02e-3)
    second = search.closest_opposite(shell.body, shell.wall, p, p, 2e-3, (0.0, 1.0, 0.0))
    assert np.sqrt(second[1]) == pytest.approx(1.5e-3, abs=0.02e-3)
    none = search.closest_opposite(shell.body, shell.wall, p, p, 1.4e-3, (0.0, 1.0, 0.0))
    assert none[0] == search.NOT_FOUND


def test_a_search_does_not_lose_the_other_wall_that_was_followed():
    """It gives it up as late as a tick without a search: at right angles, not as soon as it would not take it up."""
    mesh = duct_mesh(n_around=96)
    flattening = np.zeros((mesh.n_vertices, 3, 1))
    flattening[:, 1, 0] = -mesh.vertices_m[:, 1]
    surface = type(wavy_surface(mesh, np.random.default_rng(0)))(mesh, flattening, np.ones(1), 0.25e-3)
    surface.update(np.array([0.7]))
    detector, pairs, cosines = CatheterContactDetector(surface, 1, 0.2e-3, 0.3e-3), ContactPairs.allocate(64), []
    probes = detector._detection.probes
    for z in np.arange(0.0, 3.45e-3, 50e-6):  # towards the sharp end of the lumen
        for is_searched in (False, True):
            if is_searched:
                probes.seen[0] = 0.0
            pairs.clear()
            detector.detect(np.array([[20e-3, 20e-6, z]]), pairs)
            assert probes.triangle[0, 1] != search.NOT_FOUND
            cosines.append(probes.normal[0, 0] @ probes.normal[0, 1])
    assert -0.25 < max(cosines) < 0.0


def test_a_tick_costs_about_the_same_on_a_finer_mesh():
    """Work per tick of a catheter that slides along a breathing wall, over a 16-fold finer mesh.

    Triangle tests do not grow (they fall where the wall no longer folds by as much as a flank); nodes placed and boxes
    visited grow by about one constant for each refinement.
    """
    costs = []
    for n in (24, 48, 96):
        surface = wavy_surface(duct_mesh(n, 2 * n), np.random.default_rng(1))
        q = random_coordinates(np.random.default_rng(2), 1e-3)
        detector, pairs = CatheterContactDetector(surface, 21, 0.8e-3, 0.5e-3), ContactPairs.allocate(64)
        bottom = np.flatnonzero(np.hypot(surface.mesh.vertices_m[:, 1] + 4e-3, surface.mesh.vertices_m[:, 2]) < 1e-9)
        before = surface.cost
        for tick in range(200):
            surface.update((1.0 + 0.1 * np.sin(0.02 * tick)) * q)
            wall = np.empty((len(bottom), 3))
            surface.node_positions(bottom.astype(np.int32), wall)
            along = np.linspace(10e-3, 38e-3, 21) - tick * 0.02e-3
            x = np.stack([np.interp(along, wall[:, 0], wall[:, k]) for k in range(3)], axis=1)
            x[:, 1] += 1.05e-3
            pairs.clear()
            detector.detect(x, pairs)
        after = surface.cost
        costs.append([(getattr(after, k) - getattr(before, k)) / 200.0 for k in ("triangle_tests", "tree_visits")])
    tests, visits = np.transpose(costs)
    assert pairs.count >= 21
    assert max(tests[1] / tests[0], tests[2] / tests[1]) < 1.2, f"triangle tests a tick: {tests}"
    assert visits[2] < 4.0 * visits[0], f"boxes visited a tick: {visits}"


def test_probes_that_move_together_search_one_after_another():
    """21 particles in line, all near the wall, use up their slack in the same tick: no tick may pay for all of them."""
    surface = wavy_surface(duct_mesh(), np.random.default_rng(1))
    detector, pairs = CatheterContactDetector(surface, 21, 0.8e-3, 0.5e-3), ContactPairs.allocate(64)
    q, searches = random_coordinates(np.random.default_rng(2), 1e-4), []
    x = np.zeros((21, 3))
    x[:, 1] = -2.6e-3
    for tick in range(400):
        surface.update(q)
        x[:, 0] = np.linspace(10e-3, 38e-3, 21) - tick * 0.02e-3
        pairs.clear()
        before = surface.cost.searches
        detector.detect(x, pairs)
        searches.append(surface.cost.searches - before)
    assert searches[0] == 21
    assert sum(searches[1:]) > 100
    assert max(searches[1:]) <= 2


def test_a_cap_of_least_area_closes_a_rim():
    mesh = duct_mesh(n_around=36)
    rim = mesh.vertex_sets["mouth"]
    a, b, c = (mesh.vertices_m[fill_rim(mesh.vertices_m, rim)[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    assert area == pytest.approx(0.5 * 36 * np.sin(2.0 * np.pi / 36) * 16e-6)
    surface = wavy_surface(mesh, np.random.default_rng(0))
    edges = np.concatenate([mesh.triangles, *(fill_rim(mesh.vertices_m, loop) for loop in surface.rims)])
    directed = edges[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert len({tuple(e) for e in directed}) == len(directed)
    assert {tuple(e) for e in directed} == {tuple(e[::-1]) for e in directed}
