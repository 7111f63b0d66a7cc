"""Triangle surface meshes: vertices, triangles, named vertex sets, and the topology read off them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class TriangleMesh:
    """A surface of flat triangles with named sets of vertices.

    On a duct wall the triangles are wound so that normals point away from the lumen.

    Attributes:
        vertices_m: (n, 3) positions.
        triangles: (m, 3) vertex indices, counter-clockwise seen from outside.
        vertex_sets: Name to vertex indices; ``clamped`` and ``mouth`` on a duct, rims in order round the rim.
    """

    vertices_m: FloatArray
    triangles: IntArray
    vertex_sets: Mapping[str, IntArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices_m, dtype=np.float64)
        triangles = np.ascontiguousarray(self.triangles, dtype=np.int32)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not len(vertices):
            raise ValueError(f"mesh: vertices_m has shape {vertices.shape}, expected (n, 3)")
        if triangles.ndim != 2 or triangles.shape[1] != 3 or not len(triangles):
            raise ValueError(f"mesh: triangles has shape {triangles.shape}, expected (m, 3)")
        if not np.isfinite(vertices).all():
            place = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
            raise ValueError(f"mesh: vertex {place} is not finite")
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            strange = triangles.min() if triangles.min() < 0 else triangles.max()
            raise ValueError(f"mesh: a triangle names vertex {strange}, there are {len(vertices)}")
        sets = {name: np.ascontiguousarray(ids, dtype=np.int32) for name, ids in self.vertex_sets.items()}
        for name, ids in sets.items():
            if ids.ndim != 1 or (len(ids) and (ids.min() < 0 or ids.max() >= len(vertices))):
                raise ValueError(f"mesh: vertex set '{name}' names vertices that do not exist")
        object.__setattr__(self, "vertices_m", vertices)
        object.__setattr__(self, "triangles", triangles)
        object.__setattr__(self, "vertex_sets", sets)

    @property
    def n_vertices(self) -> int:
        """Number of vertices n."""
        return len(self.vertices_m)

    @property
    def n_triangles(self) -> int:
        """Number of triangles m."""
        return len(self.triangles)


def triangle_area_vectors(mesh: TriangleMesh) -> FloatArray:
    """Return outward normals (m, 3) scaled by the triangles' areas in m²."""
    a, b, c = (mesh.vertices_m[mesh.triangles[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def triangle_areas_m2(mesh: TriangleMesh) -> FloatArray:
    """Return the areas (m,) of the triangles."""
    areas: FloatArray = np.linalg.norm(triangle_area_vectors(mesh), axis=1)
    return areas


def smallest_angles_rad(mesh: TriangleMesh) -> FloatArray:
    """Return the smallest angle (m,) of each triangle."""
    corners = mesh.vertices_m[mesh.triangles]
    to_next, to_last = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    sine = np.linalg.norm(np.cross(to_next, to_last), axis=2)
    angles: FloatArray = np.arctan2(sine, np.sum(to_next * to_last, axis=2)).min(axis=1)
    return angles


def vertex_normals(mesh: TriangleMesh) -> FloatArray:
    """Return unit normals (n, 3), the area-weighted mean of the triangles round each vertex."""
    area_vectors = triangle_area_vectors(mesh)
    normals = np.zeros_like(mesh.vertices_m)
    for corner in range(3):
        np.add.at(normals, mesh.triangles[:, corner], area_vectors)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(length > 0.0, length, 1.0)


def vertex_areas_m2(mesh: TriangleMesh) -> FloatArray:
    """Return a third of the area of the triangles round each vertex (n,); their sum is the surface's area."""
    areas = np.zeros(mesh.n_vertices)
    np.add.at(areas, mesh.triangles, triangle_areas_m2(mesh)[:, None] / 3.0)
    return areas


def half_edges(mesh: TriangleMesh) -> IntArray:
    """Return directed edges (3 m, 2); row 3 t + k is edge k -> k + 1 of triangle t."""
    return mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)


def edge_of_half_edges(mesh: TriangleMesh) -> tuple[IntArray, IntArray, IntArray]:
    """Return undirected edges (e, 2), lower index first and ascending, the edge of each half-edge (3 m,), and the
    number of triangles at each edge (e,).
    """
    directed = half_edges(mesh).astype(np.int64)
    keys = directed.min(axis=1) * mesh.n_vertices + directed.max(axis=1)
    found, edge, counts = np.unique(keys, return_inverse=True, return_counts=True)
    edges = np.stack(np.divmod(found, mesh.n_vertices), axis=1)
    return edges.astype(np.int32), edge.ravel().astype(np.int32), counts.astype(np.int32)


def unique_edges(mesh: TriangleMesh) -> tuple[IntArray, IntArray]:
    """Return undirected edges (e, 2), lower index first, and the number of triangles at each (e,)."""
    edges, _, counts = edge_of_half_edges(mesh)
    return edges, counts


def paired_half_edges(mesh: TriangleMesh) -> IntArray:
    """Return the two half-edges (k, 2) of every edge shared by exactly two triangles; triangle h // 3 has h."""
    _, edge, counts = edge_of_half_edges(mesh)
    order = np.argsort(edge, kind="stable")
    pairs: IntArray = order[counts[edge[order]] == 2].reshape(-1, 2).astype(np.int32)
    return pairs


def vertex_adjacency(mesh: TriangleMesh) -> scipy.sparse.csr_array[np.int8]:
    """Return a sparse matrix (n, n) with a one where two vertices share an edge."""
    edges, _ = unique_edges(mesh)
    rows, columns = np.concatenate([edges, edges[:, ::-1]]).T
    ones = np.ones(len(rows), np.int8)
    return scipy.sparse.coo_array((ones, (rows, columns)), shape=(mesh.n_vertices,) * 2).tocsr()


def vertex_components(mesh: TriangleMesh) -> IntArray:
    """Return the index (n,) of each vertex's connected component; an unused vertex is its own component."""
    _, labels = scipy.sparse.csgraph.connected_components(vertex_adjacency(mesh), directed=False)
    return labels.astype(np.int32)


def boundary_loops(mesh: TriangleMesh) -> list[IntArray]:
    """Return the open rims, longest first, each in order along the direction of its triangles' edges.

    Raises ValueError if a rim branches at a vertex, so the surface is not a manifold there.
    """
    directed = half_edges(mesh)
    _, edge, counts = edge_of_half_edges(mesh)
    boundary = directed[counts[edge] == 1]
    successor = dict(boundary.tolist())
    if len(successor) != len(boundary):
        starts, times = np.unique(boundary[:, 0], return_counts=True)
        raise ValueError(f"mesh: open rims meet at vertex {starts[times > 1][0]}, the surface branches there")
    loops: list[IntArray] = []
    while successor:
        start, following = successor.popitem()
        loop = [start]
        while following != start:
            loop.append(following)
            following = successor.pop(following)
        loops.append(np.array(loop, np.int32))
    return sorted(loops, key=lambda rim: (-len(rim), int(rim.min())))
