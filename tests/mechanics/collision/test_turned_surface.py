"""A wall whose sections turn: placed as the warp says, and never lost by the tree however far it bends."""

import numpy as np
import pytest
from collision_cases import HALF_M, deformed, distances_to_triangles, duct_mesh

from services.mechanics.collision import CollisionSurface, search
from services.mechanics.collision.motion_bounds import TurnedBounds
from services.mechanics.fem import ElementChoice, ShellModel, ShellSection, clamp
from services.mechanics.reduction.build import build_basis
from services.mechanics.reduction.large_rotations.warping import TubeWarp
from tests.mechanics.reduction.large_rotations.warped import warped_positions

MODES = 24


@pytest.fixture(scope="module")
def duct():
    """Mesh, basis and warp of a small duct."""
    mesh = duct_mesh(n_around=16, n_along=26)
    section = ShellSection(1e-3, 300e3, 0.45, 1060.0)
    basis = build_basis(ShellModel(mesh, section, [clamp(mesh)], ElementChoice("cst", "dkt")), MODES)
    return mesh, basis, TubeWarp.from_basis(mesh, basis, mesh.vertex_sets["clamped"])


@pytest.fixture
def surface(duct):
    mesh, basis, warp = duct
    return CollisionSurface(mesh, basis.Phi, basis.omega_rad_s, HALF_M, warp)


def bent_far(rng, basis, warp):
    """Modal coordinates whose farthest section turns by about a right angle, with everything else excited a little."""
    q = rng.standard_normal(basis.n_modes) / basis.omega_rad_s**2
    return q * rng.uniform(0.5, 1.8) / np.linalg.norm(warp.turn[-1] @ q)


def test_nodes_are_placed_where_the_warp_puts_them(duct, surface):
    mesh, basis, warp = duct
    rng = np.random.default_rng(1)
    loaded = rng.choice(mesh.n_vertices, 6, replace=False).astype(np.int32)
    residual, extra = rng.normal(size=(6, 3)) * 0.5e-3, np.zeros_like(mesh.vertices_m)
    extra[loaded] = residual
    for q in (np.zeros(MODES), 1e-6 * bent_far(rng, basis, warp), bent_far(rng, basis, warp)):
        surface.update(q, loaded, residual)
        assert deformed(surface) == pytest.approx(warped_positions(warp, q, extra), abs=1e-15)


def test_closest_point_equals_brute_force_on_a_wall_that_bends_far(duct, surface):
    """A random walk to and fro over right angles: what boxes were seen at must have grown by all that has happened."""
    mesh, basis, warp = duct
    rng = np.random.default_rng(2)
    shell, end = surface.shell, bent_far(rng, basis, warp)
    for tick in range(60):
        q = np.sin(0.1 * tick) * end + 0.03 * bent_far(rng, basis, warp)
        loaded = rng.choice(mesh.n_vertices, 3, replace=False).astype(np.int32)
        surface.update(q, loaded, rng.normal(size=(3, 3)) * 0.3e-3)
        vertices = deformed(surface)
        for p in vertices[rng.integers(0, mesh.n_vertices, 6)] + rng.normal(size=(6, 3)) * 2e-3:
            expected = distances_to_triangles(p, vertices, mesh.triangles).min()
            at = tuple(map(float, p))
            found = search.closest(shell.body, shell.wall, at, at, 1.0, search.NOT_FOUND)
            assert np.sqrt(found[1]) == pytest.approx(expected, abs=1e-12)


def test_no_vertex_moves_farther_than_its_bounds_say(duct, surface):
    """Against one another by `TurnedBounds`; alone by what the surface adds up of its sections' motion."""
    mesh, basis, warp = duct
    bounds, rng = TurnedBounds(warp, basis.omega_rad_s), np.random.default_rng(3)
    vertex, other = rng.integers(0, mesh.n_vertices, (2, 400))
    reach, spread = bounds.reach(np.arange(mesh.n_vertices)), bounds.spread(vertex, other)
    body, nearest = surface.shell.body, 0.0
    for _ in range(40):
        q, step = (bent_far(rng, basis, warp) for _ in range(2))
        # The whole way, and a small step at the far end of it.
        for start, end in ((0.0 * q, q), (q, q + 0.02 * step)):
            norm = max(np.linalg.norm(basis.omega_rad_s * at) for at in (start, end))
            moved = np.linalg.norm(basis.omega_rad_s * (end - start)) * (1.0 + bounds.growth * norm) ** 2
            shift = warped_positions(warp, end) - warped_positions(warp, start)
            relative = np.linalg.norm(shift[vertex] - shift[other], axis=1)
            assert (relative <= spread * moved + 1e-15).all()
            surface.update(start)
            before = float(body.turned_travel)
            surface.update(end)
            carried = float(body.turned_travel) - before
            alone = np.linalg.norm(shift, axis=1)
            assert (alone <= reach * moved + carried + 1e-15).all()
            from_rest = np.linalg.norm(warped_positions(warp, end) - mesh.vertices_m, axis=1)
            assert (from_rest <= reach * moved + body.turned_shift + 1e-15).all() or start.any()
            nearest = max(nearest, alone.max() / (reach.max() * moved + carried))
    assert nearest > 0.3, "bounds this loose would find nothing"
