"""Nonlinear membrane: the wall stiffens as it stretches."""

from __future__ import annotations

from dataclasses import dataclass, replace

from trocar.services.mechanics.effects.base import recipe_of, require_positive
from trocar.services.mechanics.effects.wall_term import WallTerm
from trocar.services.mechanics.reduction.nonlinear.quadratic_manifold import fetch_membrane_force
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.world import World


@dataclass(frozen=True, slots=True)
class NonlinearMembraneSettings:
    """Number of lowest modes in the polynomial; the cost grows with its fourth power."""

    n_coordinates: int = 12

    def __post_init__(self) -> None:
        require_positive(self, "n_coordinates")


class NonlinearMembrane(WallTerm):
    """Geometric stiffness of the wall as a cubic polynomial of the lowest modes."""

    Settings = NonlinearMembraneSettings

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
        force = fetch_membrane_force(recipe, duct.basis, self.settings.n_coordinates, duct.cache_dir)
        self.take_terms(world).polynomial = force
