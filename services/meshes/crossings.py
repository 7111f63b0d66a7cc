"""Triangles of one surface that cut through each other."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.surface.mesh import TriangleMesh

CHUNK = 2048
"""Triangles whose candidate partners are held at the same time."""
CORNER_PAIRS = ((0, 1), (1, 2), (2, 0))


def crossing_triangles(mesh: TriangleMesh) -> IntArray:
    """Sorted triangles that intersect another one with which they share no vertex.

    An edge crosses a triangle when its ends lie strictly on both sides and the piercing point lies inside; sheets that
    only touch, or overlap in one plane, are not found.
    """
    corners = mesh.vertices_m[mesh.triangles]
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    tree = cKDTree(centres)
    crossing = np.zeros(mesh.n_triangles, bool)
    for start in range(0, mesh.n_triangles, CHUNK):
        chunk = np.arange(start, min(start + CHUNK, mesh.n_triangles))
        # Every pair is found from its larger triangle, so that one long sliver does not make all look far.
        near = tree.query_ball_point(centres[chunk], 2.0 * radii[chunk])
        larger = np.repeat(chunk, [len(found) for found in near])
        smaller = np.concatenate([np.asarray(found, np.int64) for found in near])
        is_ordered = (radii[smaller] < radii[larger]) | ((radii[smaller] == radii[larger]) & (smaller < larger))
        pairs = _candidates(mesh, corners, np.stack([larger[is_ordered], smaller[is_ordered]], axis=1))
        one, other = corners[pairs[:, 0]], corners[pairs[:, 1]]
        crossing[pairs[_edges_pierce(one, other) | _edges_pierce(other, one)].ravel()] = True
    return np.flatnonzero(crossing).astype(np.int32)


def _candidates(mesh: TriangleMesh, corners: FloatArray, pairs: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Those pairs whose boxes overlap and which share no vertex."""
    one, other = corners[pairs[:, 0]], corners[pairs[:, 1]]
    overlap = (one.min(axis=1) <= other.max(axis=1)) & (other.min(axis=1) <= one.max(axis=1))
    pairs = pairs[overlap.all(axis=1)]
    names = mesh.triangles[pairs]
    shared = (names[:, 0, :, None] == names[:, 1, None, :]).any(axis=(1, 2))
    separate: npt.NDArray[np.int64] = pairs[~shared]
    return separate


def _edges_pierce(edges_of: FloatArray, triangles: FloatArray) -> npt.NDArray[np.bool_]:
    """(k,) whether an edge of the first triangle passes through the second."""
    a, b, c = triangles.transpose(1, 0, 2)
    hit = np.zeros(len(triangles), bool)
    for i, j in CORNER_PAIRS:
        p, q = edges_of[:, i], edges_of[:, j]
        opposite = _side(a, b, c, p) * _side(a, b, c, q) < 0.0
        turns = np.stack([_side(p, q, a, b), _side(p, q, b, c), _side(p, q, c, a)])
        hit |= opposite & ((turns > 0.0).all(axis=0) | (turns < 0.0).all(axis=0))
    return hit


def _side(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """(k,) six times the signed volume of the tetrahedron abcd."""
    volume: FloatArray = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)
    return volume
