"""The tree of a wall and what moves its regions are found once for a wall that is built twice, else anew."""

from __future__ import annotations

import numpy as np
import pytest

from services.mechanics.collision import CollisionSurface, regions, surface
from services.mechanics.collision.aabb_tree import build_tree
from services.mechanics.collision.kept import Kept
from services.mechanics.surface.tube import DuctGeometry, parametric_duct

HALF_M = 0.25e-3


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Count the regions whose singular vectors are taken."""
    taken: list[int] = []
    leading = regions._leading

    def counted(modes: np.ndarray) -> tuple[np.ndarray, float]:
        taken.append(len(modes))
        return leading(modes)

    monkeypatch.setattr(regions, "_leading", counted)
    monkeypatch.setattr(regions, "_moved_by", Kept(regions._measured, 1))
    return taken


def test_a_wall_that_is_built_twice_is_measured_once_and_another_anew(found: list[int]) -> None:
    mesh = parametric_duct(DuctGeometry(0.004, 0.06, 24, 40))
    random = np.random.default_rng(5)
    modes, omega_rad_s = random.normal(size=(mesh.n_vertices, 3, 7)), np.linspace(100.0, 900.0, 7)
    first = CollisionSurface(mesh, modes, omega_rad_s, HALF_M).shell.body.regions
    c = len(first.left)
    assert len(found) == c > 1
    again = CollisionSurface(mesh, modes.copy(), omega_rad_s.copy(), HALF_M).shell.body.regions
    assert len(found) == c
    assert (again.shape == first.shape).all()
    assert (again.left == first.left).all()
    assert again.stamp is not first.stamp, "what a tick writes is each wall's own"
    modes[3, 1, 2] += 1e-9  # in place
    other = CollisionSurface(mesh, modes, omega_rad_s, HALF_M).shell.body.regions
    assert len(found) == 2 * c
    assert (other.shape != first.shape).any()
    CollisionSurface(mesh, modes, 2.0 * omega_rad_s, HALF_M)
    assert len(found) == 3 * c


def test_the_trees_of_a_surface_are_kept_and_only_those_of_the_same_wall(monkeypatch: pytest.MonkeyPatch) -> None:
    built: list[int] = []

    def counted(vertices_m: np.ndarray, triangles: np.ndarray, bounds: object) -> object:
        built.append(len(triangles))
        return build_tree(vertices_m, triangles, bounds)

    monkeypatch.setattr(surface, "_tree", Kept(counted, 3))
    mesh, stiffer = (parametric_duct(DuctGeometry(0.004, 0.06, 24, 40)) for _ in range(2))
    modes, omega_rad_s = np.random.default_rng(5).normal(size=(mesh.n_vertices, 3, 7)), np.linspace(100.0, 900.0, 7)
    first = CollisionSurface(mesh, modes, omega_rad_s, HALF_M).shell.wall
    assert len(built) == 3
    assert (CollisionSurface(stiffer, modes, omega_rad_s, 2.0 * HALF_M).shell.wall.boxes == first.boxes).all()
    assert len(built) == 3
    assert not (CollisionSurface(mesh, modes, 2.0 * omega_rad_s, HALF_M).shell.wall.boxes == first.boxes).all()
    assert len(built) == 6
