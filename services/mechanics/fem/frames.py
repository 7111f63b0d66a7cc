"""Local frames of the triangles: origin at node 1, y along edge 12, z along the outward normal."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.mesh import TriangleMesh

DEGENERATE_HEIGHT_RATIO = 1e-6
"""A triangle whose height is below this part of its longest edge has no usable frame."""


def local_frames(mesh: TriangleMesh) -> FloatArray:
    """(m, 3, 3) rows are the local x, y and z axes in global components (paper, section II-C.1 b).

    Raises ValueError if a triangle is degenerate; the message names it and where it lies.
    """
    p1, p2, p3 = (mesh.vertices_m[mesh.triangles[:, k]] for k in range(3))
    normal = np.cross(p2 - p1, p3 - p1)
    double_area = np.linalg.norm(normal, axis=1)
    longest = np.max([np.linalg.norm(e, axis=1) for e in (p2 - p1, p3 - p2, p1 - p3)], axis=0)
    flat = double_area <= DEGENERATE_HEIGHT_RATIO * longest**2
    if flat.any():
        t = int(np.flatnonzero(flat)[0])
        place_mm = np.round(1e3 * mesh.vertices_m[mesh.triangles[t]].mean(axis=0), 3).tolist()
        raise ValueError(f"mesh: triangle {t} at {place_mm} mm has no area")
    y = (p2 - p1) / np.linalg.norm(p2 - p1, axis=1, keepdims=True)
    z = normal / double_area[:, None]
    return np.stack([np.cross(y, z), y, z], axis=1)


def local_coordinates(mesh: TriangleMesh, frames: FloatArray) -> FloatArray:
    """(m, 3, 2) nodes in the local plane, counter-clockwise, node 1 at the origin and node 2 on the y axis."""
    corners = mesh.vertices_m[mesh.triangles]
    relative = corners - corners[:, :1]
    xy: FloatArray = np.matmul(relative, frames[:, :2].transpose(0, 2, 1))
    return xy
