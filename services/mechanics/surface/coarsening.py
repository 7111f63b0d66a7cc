"""Coarsening of a surface to fewer of its own vertices: the dual of a partition into patches round spread-out seeds.

Patches are nearest by path length along edges, so that triangles join three neighbouring patches as in a Delaunay
triangulation (Valette and Chassery, Computer Graphics Forum 23:381, 2004, without moving the seeds).
"""

from __future__ import annotations

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import (
    TriangleMesh,
    boundary_loops,
    triangle_areas_m2,
    unique_edges,
    vertex_components,
)

TRIES = (1.0, 0.9, 1.1, 0.8, 1.25)
"""Multiples of the desired number of vertices, tried in turn until the surface keeps its topology."""
FEWEST_ON_RIM = 6


def coarsened(mesh: TriangleMesh, n_vertices: int) -> tuple[TriangleMesh, IntArray]:
    """Return the surface on about ``n_vertices`` of its vertices, and their indices; vertex sets are mapped.

    Raises ValueError if no such surface with the same holes and rims was found.
    """
    for part in TRIES:
        seeds = _spread(mesh, int(part * n_vertices))
        coarse = _dual(mesh, seeds)
        if coarse is not None and _topology(coarse) == _topology(mesh):
            return coarse, seeds
    raise ValueError(f"mesh: no surface of about {n_vertices} of its vertices has the same rims")


def _spread(mesh: TriangleMesh, n: int) -> IntArray:
    """Return seeds: evenly along every rim, then repeatedly the vertex furthest from all seeds so far."""
    x = mesh.vertices_m
    spacing_m = np.sqrt(2.0 / np.sqrt(3.0) * triangle_areas_m2(mesh).sum() / n)
    seeds: list[int] = []
    distance = np.full(len(x), np.inf)
    for rim in boundary_loops(mesh):
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(x[[*rim, rim[0]]], axis=0), axis=1))])
        k = min(len(rim), max(FEWEST_ON_RIM, round(way[-1] / spacing_m)))
        following = np.searchsorted(way[:-1], np.arange(k) * way[-1] / k - 1e-12) % len(rim)  # of the last, the first
        seeds += np.unique(rim[following]).tolist()
        distance[rim] = 0.0
    for seed in seeds:
        distance = np.minimum(distance, np.linalg.norm(x - x[seed], axis=1))
    if not seeds:
        distance = np.linalg.norm(x - x.mean(axis=0), axis=1)
    while len(seeds) < min(n, len(x)):
        seeds.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(x - x[seeds[-1]], axis=1))
    return np.array(seeds, np.int32)


def _dual(mesh: TriangleMesh, seeds: IntArray) -> TriangleMesh | None:
    """Return the mesh that joins seeds whose patches meet in a triangle; None if it is no surface."""
    patch = _patches(mesh, seeds)[mesh.triangles]
    corners = patch[(patch[:, 0] != patch[:, 1]) & (patch[:, 1] != patch[:, 2]) & (patch[:, 2] != patch[:, 0])]
    _, first = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)
    if len(first) == 0:
        return None
    place = np.full(mesh.n_vertices, -1)
    place[seeds] = np.arange(len(seeds))
    sets = {name: place[ids][place[ids] >= 0].astype(np.int32) for name, ids in mesh.vertex_sets.items()}
    return TriangleMesh(mesh.vertices_m[seeds], corners[first].astype(np.int32), sets)


def _patches(mesh: TriangleMesh, seeds: IntArray) -> IntArray:
    """Return the index (n,) of the seed nearest to each vertex along edges."""
    edges, _ = unique_edges(mesh)
    length: FloatArray = np.linalg.norm(mesh.vertices_m[edges[:, 0]] - mesh.vertices_m[edges[:, 1]], axis=1)
    graph = scipy.sparse.coo_array((length, edges.T), shape=(mesh.n_vertices,) * 2).tocsr()
    _, _, nearest = scipy.sparse.csgraph.dijkstra(
        graph, directed=False, indices=seeds, min_only=True, return_predecessors=True
    )
    place = np.zeros(mesh.n_vertices, np.int32)
    place[seeds] = np.arange(len(seeds))
    return place[nearest]


def _topology(mesh: TriangleMesh) -> tuple[int, int, int] | None:
    """Return (components, rims, Euler characteristic); None for a surface that is not a manifold."""
    edges, shared = unique_edges(mesh)
    try:
        n_rims = len(boundary_loops(mesh))
    except ValueError:
        return None
    if shared.max() > 2:
        return None
    return int(vertex_components(mesh).max()) + 1, n_rims, mesh.n_vertices - len(edges) + mesh.n_triangles
