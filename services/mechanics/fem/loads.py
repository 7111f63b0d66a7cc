"""Consistent nodal loads of a pressure."""

from __future__ import annotations

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.surface.mesh import TriangleMesh, triangle_area_vectors


def pressure_load(mesh: TriangleMesh, pressure_pa: float | FloatArray) -> FloatArray:
    """(n, 3) nodal forces of a pressure inside, pushing along the outward normals; a number or (m,)."""
    pressure = np.broadcast_to(pressure_pa, (mesh.n_triangles,))[:, None]
    load = np.zeros((mesh.n_vertices, 3))
    np.add.at(load, mesh.triangles, (pressure * triangle_area_vectors(mesh) / 3.0)[:, None, :])
    return load
