"""What is wrong with a surface as a shell model, and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem.frames import DEGENERATE_HEIGHT_RATIO
from trocar.services.mechanics.surface.mesh import (
    TriangleMesh,
    edge_of_half_edges,
    half_edges,
    triangle_areas_m2,
    unique_edges,
    vertex_components,
)
from trocar.services.meshes.crossings import crossing_triangles
from trocar.services.meshes.winding import flipped_edges


@dataclass(frozen=True)
class Finding:
    """One kind of defect: how often, and where the first one is."""

    defect: str
    count: int
    place_m: FloatArray

    def __str__(self) -> str:
        place_mm = np.round(1e3 * self.place_m, 2).tolist()
        return f"{self.count} {self.defect}, the first at {place_mm} mm"


def check_surface(mesh: TriangleMesh, is_used: bool = True) -> list[Finding]:
    """Defects that keep a surface from being one orientable shell with open ends; empty when there are none.

    On a surface that is only the source of another (not ``is_used``) triangles that cut through others, by far the
    longest search, are left to the check of that other.
    """
    edges, shared = unique_edges(mesh)
    tests = (
        ("triangles without area", mesh.triangles[_degenerate(mesh)]),
        ("edges shared by more than two triangles", edges[shared > 2]),
        ("vertices where separate sheets touch", _touching_vertices(mesh)[:, None]),
        ("edges whose two triangles are wound against each other", flipped_edges(mesh)),
        ("vertices outside the largest connected piece", _stray_vertices(mesh)[:, None]),
        ("triangles that cut through others", mesh.triangles[crossing_triangles(mesh) if is_used else []]),
    )
    return [Finding(name, len(items), mesh.vertices_m[items[0]].mean(axis=0)) for name, items in tests if len(items)]


def _degenerate(mesh: TriangleMesh) -> IntArray:
    corners = mesh.vertices_m[mesh.triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    flat = 2.0 * triangle_areas_m2(mesh) <= DEGENERATE_HEIGHT_RATIO * longest**2
    return np.flatnonzero(flat).astype(np.int32)


def _stray_vertices(mesh: TriangleMesh) -> IntArray:
    pieces = vertex_components(mesh)
    return np.flatnonzero(pieces != np.argmax(np.bincount(pieces))).astype(np.int32)


def _touching_vertices(mesh: TriangleMesh) -> IntArray:
    """Vertices whose triangles do not all hang together by edges, so that two sheets meet in a point."""
    directed = half_edges(mesh)
    _, edge, _ = edge_of_half_edges(mesh)
    start = np.arange(len(directed))
    end = start - start % 3 + (start + 1) % 3
    is_up = directed[:, 0] < directed[:, 1]
    low, high = np.where(is_up, start, end), np.where(is_up, end, start)
    order = np.argsort(edge, kind="stable")
    joined = order[:-1][np.diff(edge[order]) == 0], order[1:][np.diff(edge[order]) == 0]
    rows = np.concatenate([low[joined[0]], high[joined[0]]])
    columns = np.concatenate([low[joined[1]], high[joined[1]]])
    links = scipy.sparse.coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(len(start),) * 2)
    _, fan = scipy.sparse.csgraph.connected_components(links, directed=False)
    fans = np.unique(mesh.triangles.ravel() * np.int64(len(start)) + fan)
    return np.flatnonzero(np.bincount(fans // len(start), minlength=mesh.n_vertices) > 1).astype(np.int32)
