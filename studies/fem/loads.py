"""Consistent nodal loads of forces at points and forces per area."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.mesh import TriangleMesh, triangle_areas_m2


def point_load(mesh: TriangleMesh, vertex: int, force_n: FloatArray) -> FloatArray:
    """(n, 3) nodal forces of one force on one vertex."""
    load = np.zeros((mesh.n_vertices, 3))
    load[vertex] = force_n
    return load


def surface_load(mesh: TriangleMesh, traction_pa: FloatArray) -> FloatArray:
    """(n, 3) nodal forces of a (3,) or (m, 3) force per area, a third of each triangle's to each corner."""
    per_corner = np.broadcast_to(traction_pa, (mesh.n_triangles, 3)) * triangle_areas_m2(mesh)[:, None] / 3.0
    load = np.zeros((mesh.n_vertices, 3))
    np.add.at(load, mesh.triangles, per_corner[:, None, :])
    return load
