"""Geometric stiffness of the wall: the part of the St. Venant-Kirchhoff membrane energy beyond the linear one.

With the displacement gradients G_a = du/dx_a along a triangle's local axes t_a, Green's strain is
E = e + eta/2, e = (t1.G1, t2.G2, t1.G2 + t2.G1), eta = (G1.G1, G2.G2, 2 G1.G2). The linear model already has
e D e / 2; what is added here is e D eta / 2 + eta D eta / 8 per area: a cubic and a quartic of the nodal
displacements, exact for St. Venant-Kirchhoff. Bending stays linear, so this is von Karman's theory where
rotations are moderate: stretching stiffens a wall that is pushed in, and a pressed tube resists.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.fem import ShellModel
from trocar.services.mechanics.fem.frames import local_coordinates, local_frames
from trocar.services.mechanics.fem.section import plane_stress_matrices
from trocar.services.mechanics.fem.triangle import shape_gradients, signed_areas


@dataclass(frozen=True, slots=True)
class Membrane:
    """The triangles of a wall as membranes of constant strain.

    Attributes:
        triangles: (m, 3) int32
        gradients: (m, 2, 3) float64. Gradients of the shape functions along the local axes, in 1/m.
        tangents: (m, 2, 3) float64. The local axes in global components.
        rigidity_n_m: (m, 3, 3) float64. Plane-stress matrix times thickness times area, in N m: energy per strain
            squared.
    """

    triangles: IntArray
    gradients: FloatArray
    tangents: FloatArray
    rigidity_n_m: FloatArray

    @classmethod
    def from_model(cls, model: ShellModel) -> Membrane:
        """Take geometry, thickness and material, orthotropic or not, from a shell model."""
        mesh, section = model.mesh, model.section
        frames = local_frames(mesh)
        xy = local_coordinates(mesh, frames)
        thickness = section.per_triangle("thickness_m", mesh.n_triangles)
        scale = (thickness * signed_areas(xy))[:, None, None]
        rigidity = scale * plane_stress_matrices(section, frames)
        return cls(mesh.triangles, shape_gradients(xy), frames[:, :2], rigidity)

    def product_force_n(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Return the in-plane forces (n, 3) of the stress D eta(u, v) / 2 that the products of slopes make."""
        eta = product_strain(self._displacement_gradients(u), self._displacement_gradients(v))
        return self._nodal(np.einsum("mij,mj->mi", self.rigidity_n_m, 0.5 * eta), self.tangents, len(u))

    def _displacement_gradients(self, u: FloatArray) -> FloatArray:
        """Return G (m, 2, 3)."""
        gradients: FloatArray = self.gradients @ u[self.triangles]
        return gradients

    def _nodal(self, stress: FloatArray, along: FloatArray, n: int) -> FloatArray:
        """Assemble the forces whose work on dG is stress . (d1.dG1, d2.dG2, d1.dG2 + d2.dG1), d = ``along``."""
        first = stress[:, :1] * along[:, 0] + stress[:, 2:] * along[:, 1]
        second = stress[:, 1:2] * along[:, 1] + stress[:, 2:] * along[:, 0]
        corners = np.einsum("man,mai->mni", self.gradients, np.stack([first, second], axis=1))
        force = np.zeros((n, 3))
        np.add.at(force, self.triangles, corners)
        return force


def product_strain(Gu: FloatArray, Gv: FloatArray) -> FloatArray:
    """Return the symmetric bilinear form whose diagonal is eta (m, 3)."""
    mixed = np.einsum("mai,mbi->mab", Gu, Gv)
    return np.stack([mixed[:, 0, 0], mixed[:, 1, 1], mixed[:, 0, 1] + mixed[:, 1, 0]], axis=1)
