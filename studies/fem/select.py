"""The vertices that a ``trocar fem`` file names: by a set, an index, a point or a box."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.studies.fem.case import Where


def select(mesh: TriangleMesh, where: Where, key: str) -> IntArray:
    """Vertices that a selector names. Raises ValueError: it names none; the message says the key and what there is."""
    if where.vertex_set is not None:
        if where.vertex_set not in mesh.vertex_sets:
            known = ", ".join(mesh.vertex_sets) or "none"
            raise ValueError(f"{key}.vertex_set: the mesh has no vertex set '{where.vertex_set}'; it has: {known}")
        return np.asarray(mesh.vertex_sets[where.vertex_set], np.int32)
    if where.vertex is not None:
        if where.vertex >= mesh.n_vertices:
            raise ValueError(f"{key}.vertex: {where.vertex} does not exist, the mesh has {mesh.n_vertices} vertices")
        return np.array([where.vertex], np.int32)
    if where.near_m is not None:
        return np.array([_nearest(mesh, np.array(where.near_m), f"{key}.near_m")], np.int32)
    low, high = np.asarray(where.box_m)
    inside = ((mesh.vertices_m >= low) & (mesh.vertices_m <= high)).all(axis=1)
    if not inside.any():
        span = [np.round(corner, 5).tolist() for corner in (mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0))]
        raise ValueError(f"{key}.box_m: holds no vertex; the mesh spans {span[0]} to {span[1]} m")
    return np.flatnonzero(inside).astype(np.int32)


def _nearest(mesh: TriangleMesh, point_m: FloatArray, key: str) -> int:
    """Nearest vertex, unless the point is further from it than its longest edge: then it is no point of this mesh."""
    distance = np.linalg.norm(mesh.vertices_m - point_m, axis=1)
    nearest = int(np.argmin(distance))
    corners = mesh.vertices_m[mesh.triangles[(mesh.triangles == nearest).any(axis=1)]]
    reach = np.linalg.norm(corners - mesh.vertices_m[nearest], axis=2).max(initial=0.0)
    if distance[nearest] > reach:
        raise ValueError(
            f"{key}: the nearest vertex, {nearest} at {place_mm(mesh, nearest)}, is "
            f"{1e3 * distance[nearest]:.4g} mm away, further than the {1e3 * reach:.3g} mm of its longest edge"
        )
    return nearest


def place_mm(mesh: TriangleMesh, vertex: int) -> str:
    """Return where a vertex lies, for a person."""
    return f"{np.round(1e3 * mesh.vertices_m[vertex], 2).tolist()} mm"
