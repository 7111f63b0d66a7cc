"""Nonlinear membrane: the wall stiffens as it stretches."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from services.mechanics.effects.base import Effect, recipe_of, require_positive
from services.mechanics.reduction.nonlinear.quadratic_manifold import fetch_membrane_force
from services.mechanics.scene import SceneModel
from services.mechanics.world import World


@dataclass(frozen=True, slots=True)
class NonlinearMembraneSettings:
    """Number of lowest modes in the polynomial; the cost grows with its fourth power."""

    n_coordinates: int = 12

    def __post_init__(self) -> None:
        require_positive(self, "n_coordinates")


class NonlinearMembrane(Effect):
    """Geometric stiffness of the wall as a cubic polynomial of the lowest modes, applied as a kick before the step.

    The splitting is symplectic: energy is bounded while the tangent stays below (2 / dt)^2. The force derives from one
    polynomial energy, so it feeds in no energy on average.
    """

    Settings = NonlinearMembraneSettings
    of_wall = True
    kicks = True

    def __init__(self, settings: NonlinearMembraneSettings, scene: SceneModel) -> None:
        super().__init__(settings, scene)
        if settings.n_coordinates > scene.duct.n_modes:
            raise ValueError(
                f"effects.nonlinear_membrane: n_coordinates {settings.n_coordinates} must not be above duct.n_modes, "
                f"{scene.duct.n_modes}"
            )

    def prepare(self, world: World) -> None:
        """Build the polynomial of the rest shape, or load it from the duct's cache.

        Raises ValueError if the duct's recipe is unknown.
        """
        duct = world.duct.reduced
        recipe = replace(recipe_of(duct, "nonlinear_membrane"), mesh=duct.mesh)
        self._force = fetch_membrane_force(recipe, duct.basis, self.settings.n_coordinates, duct.cache_dir)
        self._damping = 2.0 * duct.basis.omega_rad_s * duct.damping_ratio
        self._scratch = np.zeros((3, duct.basis.n_modes))

    def add_loads(self, world: World, dt_s: float) -> None:
        """Kick the modes."""
        self._force.kick(world.duct.state, dt_s, self._damping, self._scratch)
        world.duct.modal_kick -= self._scratch[0]

    def potential_energy_j(self, world: World) -> float:
        """Return the energy of the polynomial."""
        return self._force.energy_j(world.duct.state.q)
