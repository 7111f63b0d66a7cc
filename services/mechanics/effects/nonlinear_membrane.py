"""Nonlinear membrane: the wall stiffens as it stretches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from services.mechanics.effects.base import Effect
from services.mechanics.reduction.nonlinear.manifold import fetch_membrane_force
from services.mechanics.scene.duct_recipe import duct_recipe

if TYPE_CHECKING:
    from services.mechanics.simulation import Simulation


@dataclass(frozen=True, slots=True)
class NonlinearMembraneSettings:
    """Number of the lowest modes that take part; the cost grows with its fourth power."""

    n_coordinates: int = 12


class NonlinearMembrane(Effect):
    """Geometric stiffness of the wall as a cubic polynomial of the lowest modes, applied as a kick before the step.

    Symplectic splitting: bounded energy while the tangent stays below (2 / dt)^2. Symmetric in the step's force,
    which comes from one polynomial energy, so nothing is fed in on the average.
    """

    Settings = NonlinearMembraneSettings

    def prepare(self, simulation: Simulation) -> None:
        """Build the polynomial, or fetch it from the cache."""
        duct = simulation.duct.reduced
        recipe = duct_recipe(self.scene.duct, duct.mesh, simulation.effects)
        self._force = fetch_membrane_force(recipe, duct.basis, self.settings.n_coordinates)
        self._damping = 2.0 * duct.basis.omega_rad_s * duct.damping_ratio
        self._scratch = np.zeros((3, duct.basis.n_modes))

    def add_loads(self, simulation: Simulation, dt_s: float) -> None:
        """Kick the modes."""
        self._force.kick(simulation.duct.state, dt_s, self._damping, self._scratch)

    def potential_energy_j(self, simulation: Simulation) -> float:
        """Return the energy of the polynomial."""
        return self._force.energy_j(simulation.duct.state.q)
