"""Consistent nodal loads: points, forces per area, pressure."""

from __future__ import annotations

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.surface.mesh import TriangleMesh, triangle_area_vectors, triangle_areas_m2


def point_load(mesh: TriangleMesh, vertex: int, force_n: FloatArray) -> FloatArray:
    """(n, 3) nodal forces of one force on one vertex."""
    load = np.zeros((mesh.n_vertices, 3))
    load[vertex] = force_n
    return load


def surface_load(mesh: TriangleMesh, traction_pa: FloatArray) -> FloatArray:
    """(n, 3) nodal forces of a (3,) or (m, 3) force per area, a third of each triangle's to each corner."""
    per_corner = np.broadcast_to(traction_pa, (mesh.n_triangles, 3)) * triangle_areas_m2(mesh)[:, None] / 3.0
    return _to_corners(mesh, per_corner)


def pressure_load(mesh: TriangleMesh, pressure_pa: float | FloatArray) -> FloatArray:
    """(n, 3) nodal forces of a pressure inside, pushing along the outward normals; a number or (m,)."""
    pressure = np.broadcast_to(pressure_pa, (mesh.n_triangles,))[:, None]
    return _to_corners(mesh, pressure * triangle_area_vectors(mesh) / 3.0)


def _to_corners(mesh: TriangleMesh, per_corner: FloatArray) -> FloatArray:
    load = np.zeros((mesh.n_vertices, 3))
    np.add.at(load, mesh.triangles, per_corner[:, None, :])
    return load
