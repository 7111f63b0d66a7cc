"""Softening: a wall that softens where it is squeezed, as a thin wall does when its section folds.

Its modules are imported only for scenes with the effect: the shell of large displacements, with scipy's trees and
rotations, is a tenth of all imports of a rig's process.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from trocar.services.mechanics.effects.base import recipe_of, require_positive
from trocar.services.mechanics.effects.wall_term import WallTerm
from trocar.services.mechanics.reduction.build import Progress, ignore_progress
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.world import World

if TYPE_CHECKING:
    from trocar.services.mechanics.reduction.softening.training import WallSoftening

N_LOCAL_MODES = 16
"""Number of modes beside supports; without them three quarters of the response to a force there would be linear."""


@dataclass(frozen=True, slots=True)
class SofteningSettings:
    """Number of pinches, pokes and pulls of the nonlinear shell that the softening is trained on."""

    n_squeezes: int = 48

    def __post_init__(self) -> None:
        require_positive(self, "n_squeezes")


class Softening(WallTerm):
    """Nonlinear part of the wall's response to contact forces at large displacements.

    It is a term of the wall in the displacement along the pattern of the contact forces. It vanishes at first order:
    the wall is linear for small loads. Weight and gas pressure do not soften it.
    """

    Settings = SofteningSettings
    n_local_modes = N_LOCAL_MODES
    can_rest = True

    def train(self, duct: ReducedDuct, progress: Progress) -> None:
        """Train the softening of the wall, unless it is in the cache.

        Raises ValueError if the surface encloses no lumen.
        """
        self._fetch(duct, progress)

    def prepare(self, world: World) -> None:
        """Bring the wall's term, without a pattern."""
        from trocar.services.mechanics.reduction.softened_wall.softened_wall import SoftenedWall

        duct = world.duct.reduced
        self.take_terms(world).softened = SoftenedWall.of(duct, self._fetch(duct))

    def rest(self) -> None:
        """Begin to fade the softening out."""
        self._terms.to_fade["pattern"] = 1.0

    def wake(self) -> None:
        """Begin to fade the softening in."""
        self._terms.to_fade["pattern"] = 0.0

    @property
    def rests(self) -> bool:
        """Whether the wall is linear now."""
        return float(self._terms.step.pattern.faded[0]) == 1.0

    def _fetch(self, duct: ReducedDuct, progress: Progress = ignore_progress) -> WallSoftening:
        from trocar.services.mechanics.reduction.softening.training import fetch_softening

        recipe = recipe_of(duct, "softening")
        try:
            return fetch_softening(recipe, duct, self.settings.n_squeezes, duct.cache_dir, progress)
        except ValueError as error:
            raise ValueError(f"effects.softening: {error}") from error
