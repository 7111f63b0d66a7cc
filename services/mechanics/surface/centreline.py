"""The centrelines of a branching tube, found from its surface: from the mouth to each named end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import TriangleMesh, unique_edges, vertex_areas_m2

_BAND_EDGES = 1.5
"""Width of a band of the surface in mean edges; narrower bands would not be connected."""
_PASSES = 4
_NOT_ENDS = ("mouth", "clamped", "incision")


def centrelines(mesh: TriangleMesh) -> dict[str, FloatArray]:
    """Return for each named end but the mouth the path (m, 3) from the middle of the mouth to its own middle.

    Bands of equal distance along the surface from the mouth, in one piece each, are the nodes of a tree (Reeb's graph
    of that distance; Verroust and Lazarus, "Extracting skeletal curves from 3D scattered data", 2000), and their
    middles its points, smoothed along the tree. Paths to different ends share their points up to the fork.
    """
    mouth = mesh.vertex_sets["mouth"]
    named = {name: own for name, own in mesh.vertex_sets.items() if name not in _NOT_ENDS}
    ends = {name: own for name, own in named.items() if not np.isin(own, mouth).any()}
    if not ends:
        return {}
    tree = surface_tree(mesh, mouth)
    node, parent, middle_m = tree.node, tree.parent, tree.middle_m
    middle_m[node[mouth[0]]] = mesh.vertices_m[mouth].mean(axis=0)
    ways = {}
    for name, own in ends.items():
        at = int(np.bincount(node[own]).argmax())
        middle_m[at] = mesh.vertices_m[own].mean(axis=0)
        ways[name] = [at]
        while (at := int(parent[at])) >= 0:
            ways[name].append(at)
    _even_out(middle_m, parent, list(ways.values()))
    return {name: middle_m[nodes[::-1]] for name, nodes in ways.items()}


def _even_out(middle_m: FloatArray, parent: IntArray, ways: list[list[int]]) -> None:
    """Smooth the paths: move each inner node towards the middle of its neighbours; ends are fixed."""
    inner = np.unique(np.concatenate([way[1:-1] for way in ways]))
    steps = np.unique(np.array([step for way in ways for step in zip(way[1:], way[:-1], strict=True)]), axis=0)
    children = scipy.sparse.coo_array((np.ones(len(steps)), steps.T), shape=(len(parent), len(parent))).tocsr()
    counts = children.sum(axis=1)[inner, None]
    for _ in range(_PASSES):
        around = 0.5 * (middle_m[parent[inner]] + (children @ middle_m)[inner] / counts)
        middle_m[inner] = 0.5 * (middle_m[inner] + around)


@dataclass(frozen=True, slots=True)
class SurfaceTree:
    """Bands of equal distance along a surface from some of its vertices, as the nodes of a tree.

    Attributes:
        node: (n,) int32. The node of each vertex.
        parent: (k,) int32. The next node towards the sources, -1 at them.
        middle_m: (k, 3) float64. Centroid of the band.
        distance_m: (n,) float64. Of each vertex from the sources, along edges.
    """

    node: IntArray
    parent: IntArray
    middle_m: FloatArray
    distance_m: FloatArray


def surface_tree(mesh: TriangleMesh, sources: IntArray, band_m: float | None = None) -> SurfaceTree:
    """Return the tree of bands round the vertices ``sources``, by default as narrow as the mesh allows.

    Edges should be of about equal length, or short beside ``band_m``.
    """
    n, (edges, _) = mesh.n_vertices, unique_edges(mesh)
    length = np.linalg.norm(np.diff(mesh.vertices_m[edges], axis=1)[:, 0], axis=1)
    graph = scipy.sparse.coo_array((length, edges.T), shape=(n, n)).tocsr()
    distance, before, _ = scipy.sparse.csgraph.dijkstra(
        graph, directed=False, indices=sources, min_only=True, return_predecessors=True
    )
    band = np.floor(distance / (band_m or _BAND_EDGES * length.mean())).astype(np.int64)
    within = edges[band[edges[:, 0]] == band[edges[:, 1]]]
    alike = scipy.sparse.coo_array((np.ones(len(within)), within.T), shape=(n, n))
    count, node = scipy.sparse.csgraph.connected_components(alike, directed=False)
    parent = np.full(count, -1)
    for vertex in np.argsort(-distance):  # the nearest of each node comes last
        if before[vertex] >= 0 and node[before[vertex]] != node[vertex]:
            parent[node[vertex]] = node[before[vertex]]
    parent[node[sources]] = -1
    areas = vertex_areas_m2(mesh)
    sums = np.stack([np.bincount(node, areas * mesh.vertices_m[:, axis], count) for axis in range(3)], axis=1)
    middle_m = sums / np.bincount(node, areas, count)[:, None]
    return SurfaceTree(node.astype(np.int32), parent.astype(np.int32), middle_m, distance)
