"""What acts on a shell that moves far: forces that keep their direction, and a pressure that follows the wall."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array

from services.mechanics.arrays import FloatArray
from services.mechanics.fem.assembly import CHUNK, sum_triangles
from services.mechanics.fem.nonlinear.rotations import skew
from services.mechanics.surface.mesh import TriangleMesh


@dataclass(frozen=True)
class NonlinearLoad:
    """A full load, of which a path takes parts.

    Attributes
    ----------
    dead
        (n, 6) forces in N and moments in N m that keep their direction. A moment about a fixed axis does work that
        depends on the path unless the nodes turn about that axis.
    pressure_pa
        Pressure inside, normal to the wall wherever that is.
    imposed
        (n, 6) displacements in m and rotations in rad, used at held dofs. Several rotations of one node are imposed
        as one turn about their sum's axis.
    """

    dead: FloatArray
    pressure_pa: float
    imposed: FloatArray

    def forces(self, mesh: TriangleMesh, position_m: FloatArray) -> FloatArray:
        """(6 n,) the full load on corners at (n, 3) positions."""
        total = self.dead.copy()
        if self.pressure_pa:
            corners = position_m[mesh.triangles]
            area = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            np.add.at(total[:, :3], mesh.triangles, (self.pressure_pa / 3.0 * area)[:, None])
        return total.ravel()

    def stiffness(self, mesh: TriangleMesh, position_m: FloatArray) -> bsr_array[np.float64]:
        """(6 n, 6 n) minus the derivative of the load by displacements; not symmetric at an open rim that moves."""
        return sum_triangles(mesh, self._pressure_chunks(mesh, position_m))

    def _pressure_chunks(self, mesh: TriangleMesh, position_m: FloatArray) -> Iterator[tuple[slice, FloatArray]]:
        for start in range(0, mesh.n_triangles, CHUNK):
            part = slice(start, min(start + CHUNK, mesh.n_triangles))
            x = position_m[mesh.triangles[part]]
            opposite = np.roll(x, -2, axis=1) - np.roll(x, -1, axis=1)
            K = np.zeros((len(x), 3, 6, 3, 6))
            # A corner moved by d changes the area vector by opposite x d / 2, and every corner's force by a third.
            by_corner = -self.pressure_pa / 6.0 * skew(opposite)
            K[:, :, :3, :, :3] = by_corner.transpose(0, 2, 1, 3)[:, None]
            yield part, K.reshape(-1, 18, 18)
