"""What acts on a shell that moves far: forces that keep their direction, and a pressure that follows the wall."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import bsr_array

from services.mechanics.arrays import FloatArray
from services.mechanics.fem.assembly import sum_triangles
from services.mechanics.fem.geometric import pressure_chunks
from services.mechanics.fem.loads import pressure_load
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
            total[:, :3] += pressure_load(replace(mesh, vertices_m=position_m), self.pressure_pa)
        return total.ravel()

    def stiffness(self, mesh: TriangleMesh, position_m: FloatArray) -> bsr_array[np.float64]:
        """(6 n, 6 n) minus the derivative of the load by displacements; not symmetric at an open rim that moves."""
        return sum_triangles(mesh, pressure_chunks(replace(mesh, vertices_m=position_m), self.pressure_pa))
