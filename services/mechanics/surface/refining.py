"""Shorter edges where a surface has details: edges are halved, and no vertex is left within an edge."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trocar.services.mechanics.arrays import BoolArray, FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import TriangleMesh, edge_of_half_edges

LONGEST = 4.0 / 3.0
"""Of the wanted edge: what is longer is halved, as halves are then nearer to it than the whole (Botsch and Kobbelt,
Eurographics Symposium on Geometry Processing 2004)."""


def refine(mesh: TriangleMesh, wanted_m: Callable[[FloatArray], FloatArray]) -> TriangleMesh:
    """Return the same surface with edges of about ``wanted_m`` where its own are longer; vertices keep their numbers.

    ``wanted_m`` gives the edges (n,) wanted at points (n, 3). A triangle is cut by the middles of its halved edges into
    two, three or four: the longer diagonal is never taken.
    """
    while True:
        edges, of_half_edge, _ = edge_of_half_edges(mesh)
        ends = mesh.vertices_m[edges]
        middles = ends.mean(axis=1)
        is_long = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > LONGEST * wanted_m(middles)
        if not is_long.any():
            return mesh
        vertices = np.concatenate([mesh.vertices_m, middles[is_long]])
        numbers = np.full(len(edges), -1, np.int32)
        numbers[is_long] = mesh.n_vertices + np.arange(is_long.sum(), dtype=np.int32)
        triangles = _cut(mesh.triangles, numbers[of_half_edge].reshape(-1, 3), vertices)
        mesh = TriangleMesh(vertices, triangles)


def _cut(triangles: IntArray, middle: IntArray, vertices_m: FloatArray) -> IntArray:
    """Return triangles (m, 3) cut by the vertices ``middle`` (m, 3) of their edges k -> k + 1, -1 for none."""
    cuts = (middle >= 0).sum(axis=1)
    made = [triangles[cuts == 0]]
    whole, m = triangles[cuts == 3], middle[cuts == 3]
    made += [np.stack([whole[:, k], m[:, k], m[:, k - 1]], axis=1) for k in range(3)] + [m]
    (a, b, c), (ab, _, _) = _turned(triangles, middle, (cuts == 1), lambda has: has)
    made += [np.stack([a, ab, c], axis=1), np.stack([ab, b, c], axis=1)]
    (a, b, c), (_, bc, ca) = _turned(triangles, middle, (cuts == 2), lambda has: ~has)
    is_shorter = np.linalg.norm(vertices_m[a] - vertices_m[bc], axis=1) <= np.linalg.norm(
        vertices_m[b] - vertices_m[ca], axis=1
    )
    made.append(np.stack([c, ca, bc], axis=1))
    made.append(np.stack([a, b, np.where(is_shorter, bc, ca)], axis=1))
    made.append(np.stack([np.where(is_shorter, a, b), bc, ca], axis=1))
    return np.concatenate(made).astype(np.int32)


def _turned(
    triangles: IntArray, middle: IntArray, chosen: BoolArray, is_first: Callable[[BoolArray], BoolArray]
) -> tuple[IntArray, IntArray]:
    """Return corners (3, k) and middles (3, k) of chosen triangles, turned so that their odd edge is the first."""
    turn = np.argmax(is_first(middle[chosen] >= 0), axis=1)
    order = (turn[:, None] + np.arange(3)) % 3
    return np.take_along_axis(triangles[chosen], order, 1).T, np.take_along_axis(middle[chosen], order, 1).T
