"""Which way triangles are wound: neighbours made to agree wherever that can be told."""

from __future__ import annotations

import numpy as np
import scipy

from trocar.services.mechanics.arrays import BoolArray, FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import TriangleMesh, half_edges, paired_half_edges, triangle_areas_m2


def flipped_edges(mesh: TriangleMesh) -> IntArray:
    """(k, 2) edges whose two triangles run along them in the same direction, as on no orientable surface.

    An edge that more than two triangles share is another defect, and none of these.
    """
    directed = half_edges(mesh)
    pairs = paired_half_edges(mesh)
    flipped: IntArray = directed[pairs[directed[pairs[:, 0], 0] == directed[pairs[:, 1], 0], 0]]
    return flipped


def wind_consistently(mesh: TriangleMesh, actions: list[str], most_turned: float = 0.5) -> TriangleMesh:
    """Turn the triangles that disagree with most of their sheet; appends what it did to ``actions``.

    A sheet is what hangs together by edges that exactly two triangles share. One that has a single side is left as
    it is, and so is one of which more than ``most_turned`` of the area would have to be turned.
    """
    if not len(flipped_edges(mesh)):
        return mesh
    turned, share = _minority(mesh)
    turned &= share <= most_turned
    if not turned.any():
        return mesh
    triangles = mesh.triangles.copy()
    triangles[turned] = triangles[turned][:, ::-1]
    actions.append(f"turned {int(turned.sum())} triangles that were wound against their neighbours")
    return TriangleMesh(mesh.vertices_m, triangles, mesh.vertex_sets)


def joined_triangles(mesh: TriangleMesh) -> tuple[IntArray, IntArray, BoolArray]:
    """(k,) and (k,) triangles on both sides of each edge that two share, and (k,) whether they run it the same way."""
    directed = half_edges(mesh)
    pairs = paired_half_edges(mesh)
    is_same = directed[pairs[:, 0], 0] == directed[pairs[:, 1], 0]
    return (pairs[:, 0] // 3).astype(np.int32), (pairs[:, 1] // 3).astype(np.int32), is_same


def _minority(mesh: TriangleMesh) -> tuple[BoolArray, FloatArray]:
    """(m,) triangles to turn, and (m,) the part of their sheet's area that these are; infinite on one-sided sheets.

    Every triangle is taken twice, as it is and turned; neighbours are joined where they agree. A sheet with two sides
    falls into two pieces, one the other turned; on a one-sided sheet both hang together.
    """
    m = mesh.n_triangles
    one, other, is_same = joined_triangles(mesh)
    across = np.where(is_same, m, 0)
    rows = np.concatenate([one, one + m])
    columns = np.concatenate([other + across, other + m - across])
    links = scipy.sparse.coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(2 * m, 2 * m))
    n_pieces, piece = scipy.sparse.csgraph.connected_components(links, directed=False)
    as_it_is, as_turned = piece[:m], piece[m:]
    kept_area = np.bincount(as_it_is, triangle_areas_m2(mesh), minlength=n_pieces)
    mine, against = kept_area[as_it_is], kept_area[as_turned]
    turned = (mine < against) | ((mine == against) & (as_it_is > as_turned))
    share = np.minimum(mine, against) / (mine + against)
    return turned, np.where(as_it_is == as_turned, np.inf, share)
