"""The membrane's energy and forces in nodal displacements, against which the reduced ones are checked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction.nonlinear.membrane import Membrane, product_strain


@dataclass(frozen=True, slots=True)
class ExactMembrane(Membrane):
    """A membrane that also gives its energy and forces."""

    def energy_j(self, u: FloatArray) -> float:
        """Return the energy beyond the linear one of a displacement (n, 3) in m."""
        G = self._displacement_gradients(u)
        e, eta = product_strain(self.tangents, G), product_strain(G, G)
        stress = np.einsum("mij,mj->mi", self.rigidity_n_m, 0.5 * e + 0.125 * eta)
        return float(np.sum(stress * eta))

    def force_n(self, u: FloatArray) -> FloatArray:
        """Return the gradient (n, 3) of that energy, in N: the internal force beyond the linear one."""
        G = self._displacement_gradients(u)
        e, eta = product_strain(self.tangents, G), product_strain(G, G)
        half_product = np.einsum("mij,mj->mi", self.rigidity_n_m, 0.5 * eta)
        total = np.einsum("mij,mj->mi", self.rigidity_n_m, e + 0.5 * eta)
        return self._nodal(half_product, self.tangents, len(u)) + self._nodal(total, G, len(u))

    def quadratic_force_n(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Return the symmetric bilinear form B (n, 3) of two displacements; B(u, u) is the force's quadratic part."""
        Gu, Gv = self._displacement_gradients(u), self._displacement_gradients(v)
        force = self.product_force_n(u, v)
        for one, other in ((Gu, Gv), (Gv, Gu)):
            stress = np.einsum("mij,mj->mi", self.rigidity_n_m, product_strain(self.tangents, one))
            force += 0.5 * self._nodal(stress, other, len(u))
        return force
