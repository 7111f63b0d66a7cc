"""Closed sheets of a surface file made to face outwards, so that a pressure on them acts from outside."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.meshes.winding import joined_triangles


def face_outwards(mesh: TriangleMesh, actions: list[str]) -> TriangleMesh:
    """Turn closed sheets that enclose a negative volume; appends what it did to ``actions``."""
    one, other, is_same = joined_triangles(mesh)
    links = coo_array((np.ones(len(one), np.int8), (one, other)), shape=(mesh.n_triangles,) * 2)
    _, sheet = connected_components(links, directed=False)
    volume = np.bincount(sheet, np.linalg.det(mesh.vertices_m[mesh.triangles] - mesh.vertices_m.mean(axis=0)))
    is_closed = np.bincount(np.concatenate([one, other]), minlength=mesh.n_triangles) == 3
    inwards = volume < 0.0
    inwards[sheet[~is_closed]] = False
    inwards[sheet[one[is_same]]] = False
    turned = inwards[sheet]
    if not turned.any():
        return mesh
    triangles = np.where(turned[:, None], mesh.triangles[:, ::-1], mesh.triangles)
    actions.append(f"turned {int(inwards.sum())} closed pieces to face outwards")
    return TriangleMesh(mesh.vertices_m, triangles, mesh.vertex_sets)
