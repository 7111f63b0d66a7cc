"""Loads on a shell with large displacements: dead forces, and a pressure that follows the wall."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import bsr_array

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.fem.assembly import CHUNK, sum_triangles
from trocar.services.mechanics.fem.loads import pressure_load
from trocar.services.mechanics.surface.mesh import TriangleMesh


@dataclass(frozen=True)
class NonlinearLoad:
    """A full load, of which a path takes parts.

    Attributes:
        dead: (n, 6) forces in N and moments in N m that keep their direction. A moment about a fixed axis does work
            that depends on the path unless the nodes turn about that axis.
        pressure_pa: Pressure inside, normal to the wall wherever that is.
        imposed: (n, 6) displacements in m and rotations in rad, used at held dofs. Several rotations of one node are
            imposed as one turn about their sum's axis.
    """

    dead: FloatArray
    pressure_pa: float
    imposed: FloatArray

    def forces(self, mesh: TriangleMesh, position_m: FloatArray) -> FloatArray:
        """(6 n,) the full load on corners at (n, 3) positions."""
        total = self.dead.copy()
        if self.pressure_pa:
            total[:, :3] += pressure_load(replace(mesh, vertices_m=position_m), self.pressure_pa)
        return total.ravel()

    def stiffness(self, mesh: TriangleMesh, position_m: FloatArray) -> bsr_array[np.float64]:
        """(6 n, 6 n) minus the derivative of the load by displacements; not symmetric at an open rim that moves."""
        return sum_triangles(mesh, pressure_chunks(replace(mesh, vertices_m=position_m), self.pressure_pa))


def pressure_chunks(mesh: TriangleMesh, pressure_pa: float) -> Iterator[tuple[slice, FloatArray]]:
    """Slices of the triangles, each with minus the (k, 18, 18) derivative of its corners' forces; not symmetric."""
    corners = mesh.vertices_m[mesh.triangles]
    for start in range(0, len(corners), CHUNK):
        x = corners[start : start + CHUNK]
        opposite = np.roll(x, -2, axis=1) - np.roll(x, -1, axis=1)
        K = np.zeros((len(x), 3, 6, 3, 6))
        # A corner moved by d changes the area vector by opposite x d / 2, and every corner's force by a third.
        K[:, :, :3, :, :3] = (
            -pressure_pa / 6.0 * np.cross(opposite[:, :, None], np.eye(3)).transpose(0, 3, 1, 2)[:, None]
        )
        yield slice(start, start + CHUNK), K.reshape(-1, 18, 18)
