"""Triangles of one surface that cut through each other."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import TriangleMesh

CHUNK = 2048
"""Triangles whose candidate partners are held at the same time."""
SIZE_CLASS = 1.3
"""Triangles whose radii differ by less are looked for within the same distance."""
CORNER_PAIRS = ((0, 1), (1, 2), (2, 0))  # the sides of a triangle, by its corners


def crossing_triangles(mesh: TriangleMesh) -> IntArray:
    """Sorted triangles that intersect another one with which they share no vertex.

    An edge crosses a triangle when its ends lie strictly on both sides and the piercing point lies inside; sheets that
    only touch, or overlap in one plane, are not found.
    """
    corners = mesh.vertices_m[mesh.triangles]
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    boxes = corners.min(axis=1), corners.max(axis=1)
    crossing = np.zeros(mesh.n_triangles, bool)
    # Every pair is found from its larger triangle, so that one long sliver does not make all look far.
    by_size = np.argsort(radii, kind="stable")
    first = 0
    while first < mesh.n_triangles:
        last = int(np.searchsorted(radii[by_size], SIZE_CLASS * radii[by_size[first]], side="right"))
        smaller = scipy.spatial.cKDTree(centres[by_size[:last]])
        for start in range(first, last, CHUNK):
            chunk = by_size[start : min(start + CHUNK, last)]
            reach = 2.0 * radii[chunk].max()
            near = scipy.spatial.cKDTree(centres[chunk]).sparse_distance_matrix(smaller, reach, output_type="ndarray")
            pairs = np.stack([chunk[near["i"]], by_size[near["j"]]], axis=1)
            rank = start + near["i"] > near["j"]
            pairs = _candidates(mesh, boxes, pairs[rank])
            one, other = corners[pairs[:, 0]], corners[pairs[:, 1]]
            crossing[pairs[_edges_pierce(one, other) | _edges_pierce(other, one)].ravel()] = True
        first = last
    return np.flatnonzero(crossing).astype(np.int32)


def _candidates(
    mesh: TriangleMesh, boxes: tuple[FloatArray, FloatArray], pairs: npt.NDArray[np.int64]
) -> npt.NDArray[np.int64]:
    """Those pairs whose boxes overlap and which share no vertex."""
    low, high = boxes
    for axis in range(3):
        one, other = pairs.T
        pairs = pairs[(low[one, axis] <= high[other, axis]) & (low[other, axis] <= high[one, axis])]
    shared = np.zeros(len(pairs), bool)
    for k in range(3):
        shared |= (mesh.triangles[pairs[:, 0], k, None] == mesh.triangles[pairs[:, 1]]).any(axis=1)
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
