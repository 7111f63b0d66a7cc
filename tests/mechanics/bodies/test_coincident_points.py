"""Contact points that stand in the list twice cost nothing twice, and change no bit of what the others are given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.bodies.wall_motion import wall_motion
from trocar.services.mechanics.effects.large_rotations import LargeRotations
from trocar.services.mechanics.reduction.coincident_points import find_sources, is_copied
from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct


@pytest.fixture(scope="module", params=[False, True], ids=["straight", "turned"])
def reduced(request, cache_dir):
    scene = insertion_scene()
    effects = {"large_rotations": LargeRotations.Settings()} if request.param else {}
    duct = replace(scene.duct, n_around=16, n_along=20, n_modes=30)
    return build_scene_duct(replace(scene, duct=duct, effects=effects), cache_dir)


def some_points(reduced, n):
    random = np.random.default_rng(5)
    nodes = reduced.mesh.triangles[random.choice(len(reduced.mesh.triangles), n, replace=False)]
    weights = random.dirichlet(np.ones(3), n)
    weights[1] = 0.0  # a row that is not on the duct
    return np.ascontiguousarray(nodes, np.int32), weights


def test_a_point_that_stands_there_again_is_found():
    nodes = np.array([[1, 2, 3], [1, 2, 3], [1, 2, 3], [4, 5, 6], [4, 5, 6]], np.int32)
    weights = np.array([[0.2, 0.3, 0.5], [0.2, 0.5, 0.3], [0.2, 0.3, 0.5], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    source = np.zeros(5, np.int32)
    find_sources((nodes, weights), source, 0)
    assert source.tolist() == [0, 1, 0, 3, 3]
    copied = [(a, b) for a in range(5) for b in range(a + 1) if is_copied(source, a, b)]
    assert copied == [(2, 2), (3, 2), (4, 0), (4, 1), (4, 2), (4, 4)]


def test_compliance_and_motion_are_the_same_to_the_last_bit_with_doubles(reduced, monkeypatch):
    n = 6
    once, weights = some_points(reduced, n)
    nodes, weights = np.concatenate([once, once[:4]]), np.concatenate([weights, weights[:4]])
    k, r = len(nodes), reduced.basis.n_modes
    q, dq = np.random.default_rng(6).normal(size=(2, r)) * 1e-4
    gain = np.linspace(1.0, 2.0, r)
    loads = once[0], np.array([[0.1, 0.0, 0.2], [0.0, 0.1, 0.0], [0.3, 0.0, 0.0]])

    def given():
        motion = wall_motion(reduced, k)
        motion.update(q)
        rows, W = (np.zeros((3 * k, r)), np.zeros((k, 3)), np.zeros((k, 3))), np.zeros((3 * k, 3 * k))
        motion.gather((nodes, weights), (q, dq), loads, rows)
        motion.compliance_uncached((nodes, weights), rows[0], gain, W)
        below = np.kron(np.tril(np.ones((k, k))), np.ones((3, 3)))
        return *rows, W * below

    found = given()
    with monkeypatch.context() as without:
        without.setattr(
            "trocar.services.mechanics.bodies.wall_motion.find_sources",
            lambda points, source, _: source.put(range(k), range(k)),
        )
        expected = given()
    for one, other in zip(found, expected, strict=True):
        assert (one == other).all()
    assert np.abs(found[3]).max() > 0.0


def test_rows_at_points_weigh_those_of_their_corners(reduced):
    nodes, weights = some_points(reduced, 5)
    motion = wall_motion(reduced, 5)
    q = np.random.default_rng(8).normal(size=reduced.basis.n_modes) * 1e-4
    motion.update(q)
    rows = np.zeros((15, q.size)), np.zeros((5, 3)), np.zeros((5, 3))
    motion.gather((nodes, weights), (q, q), (np.zeros(0, np.int32), np.zeros((0, 3))), rows)
    step = 1e-7
    for mode in (0, 7):
        moved = np.zeros((2, 5, 3))
        for side, sign in enumerate((-1.0, 1.0)):
            there = q.copy()
            there[mode] += sign * step
            motion.update(there)
            corners = [motion.position_function(triangle)(there) for triangle in nodes]
            moved[side] = [weight @ corner for weight, corner in zip(weights, corners, strict=True)]
        expected = (moved[1] - moved[0]).ravel() / (2.0 * step)
        assert rows[0][:, mode] == pytest.approx(expected, rel=1e-5, abs=1e-5 * np.abs(expected).max())
