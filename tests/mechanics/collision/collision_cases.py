"""Surfaces, motions and independent answers for the tests of collision detection."""

from __future__ import annotations

import numpy as np

from services.mechanics.collision import CollisionSurface
from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.surface.mesh import TriangleMesh
from services.mechanics.surface.tube import DuctGeometry, parametric_duct

RADIUS_M, LENGTH_M, HALF_M = 4e-3, 40e-3, 0.25e-3
CATHETER_M, MARGIN_M = 0.8e-3, 0.5e-3
N_MODES = 12


def duct_mesh(n_around: int = 24, n_along: int = 30, **geometry: float) -> TriangleMesh:
    return parametric_duct(
        DuctGeometry(radius_m=RADIUS_M, length_m=LENGTH_M, n_around=n_around, n_along=n_along, **geometry)
    )


def wavy_modes(mesh: TriangleMesh, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Smooth displacement fields with wavelengths from 10 to 60 mm, unit amplitude, and rising frequencies."""
    wave = 2.0 * np.pi / rng.uniform(10e-3, 60e-3, (N_MODES, 3))
    phase = rng.uniform(0.0, 2.0 * np.pi, (N_MODES, 3))
    Phi = np.stack([np.sin(mesh.vertices_m * wave[k] + phase[k]) for k in range(N_MODES)], axis=2)
    return np.ascontiguousarray(Phi), np.linspace(1.0, 10.0, N_MODES)


def wavy_surface(mesh: TriangleMesh, rng: np.random.Generator) -> CollisionSurface:
    return CollisionSurface(mesh, *wavy_modes(mesh, rng), HALF_M)


def rigid_surface(mesh: TriangleMesh) -> CollisionSurface:
    surface = CollisionSurface(mesh, np.zeros((mesh.n_vertices, 3, 0)), np.zeros(0), HALF_M)
    surface.update(np.zeros(0))
    return surface


def carried_surface(mesh: TriangleMesh) -> CollisionSurface:
    """A wall that its three coordinates, in m, carry along the axes, undeformed."""
    return CollisionSurface(mesh, np.tile(np.eye(3), (mesh.n_vertices, 1, 1)), np.ones(3), HALF_M)


def random_coordinates(rng: np.random.Generator, size_m: float) -> np.ndarray:
    return rng.normal(size=N_MODES) * size_m / np.sqrt(N_MODES)


def deformed(surface: CollisionSurface) -> np.ndarray:
    """All deformed vertices, (n, 3)."""
    every = np.arange(surface.mesh.n_vertices, dtype=np.int32)
    out = np.empty((len(every), 3))
    surface.node_positions(every, out)
    return out


def distances_to_triangles(point: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(m,) distances of one point to every triangle: the plane where the foot is inside, else the edges."""
    corners = vertices[triangles]
    best = np.full(len(triangles), np.inf)
    for k in range(3):
        p, d = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        s = np.clip(((point - p) * d).sum(1) / (d * d).sum(1), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(point - p - s[:, None] * d, axis=1))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    height = ((point - corners[:, 0]) * normal).sum(1)
    foot = point - height[:, None] * normal
    is_inside = np.ones(len(triangles), bool)
    for k in range(3):
        edge = corners[:, (k + 1) % 3] - corners[:, k]
        is_inside &= (np.cross(edge, foot - corners[:, k]) * normal).sum(1) >= 0.0
    return np.where(is_inside, np.minimum(best, np.abs(height)), best)


def nearest_candidates(segment: np.ndarray, vertices: np.ndarray, triangles: np.ndarray, parts: int = 16) -> np.ndarray:
    """Return which triangles (m,) may be the nearest of a segment (2, 3).

    No point of a segment is further from one of its marks than half the way between two of them.
    """
    marks = segment[0] + np.linspace(0.0, 1.0, parts + 1)[:, None] * (segment[1] - segment[0])
    half_m = 0.5 * np.linalg.norm(segment[1] - segment[0]) / parts
    nearest = np.min([distances_to_triangles(mark, vertices, triangles) for mark in marks], axis=0)
    return nearest - half_m <= nearest.min()


def distance_of_hulls(first: np.ndarray, second: np.ndarray) -> float:
    """Distance of two convex hulls given by points (a, 3) and (b, 3), by enumerating active sets.

    The closest points of two simplices lie in the relative interior of a face of each: solve the equality
    problem for every pair of faces and keep the feasible ones.
    """
    best = np.inf
    for face_a in _faces(len(first)):
        for face_b in _faces(len(second)):
            a, b = first[face_a], second[face_b]
            A = np.concatenate([a[1:] - a[0], b[0] - b[1:]]).T
            x = np.linalg.lstsq(A, b[0] - a[0], rcond=None)[0] if A.shape[1] else np.zeros(0)
            u, v = x[: len(a) - 1], x[len(a) - 1 :]
            if min([*u, 1.0 - u.sum(), *v, 1.0 - v.sum()]) >= -1e-12:
                best = min(best, float(np.linalg.norm(a[0] - b[0] + A @ x)))
    return best


def _faces(n: int) -> list[list[int]]:
    return [[k for k in range(n) if mask >> k & 1] for mask in range(1, 2**n)]


def rows(pairs: ContactPairs) -> list[dict[str, object]]:
    """The pairs in use, one dictionary each."""
    names = ("tool", "tool_segment", "particle", "target_kind", "target", "tool_parameter", "target_weights")
    return [
        {name: np.copy(getattr(pairs, name)[k]) for name in (*names, "normal", "gap_m")} for k in range(pairs.count)
    ]
