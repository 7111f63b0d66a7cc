"""Softening: a wall that softens where it is squeezed, as a thin wall does when its section folds.

Its modules are imported only for scenes with the effect: the shell of large displacements, with scipy's trees and
rotations, is a tenth of all imports of a rig's process.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from trocar.services.mechanics.arrays import AnyArray
from trocar.services.mechanics.effects.base import Effect, recipe_of, require_positive
from trocar.services.mechanics.reduction.build import Progress, ignore_progress
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.reduction.viscoelastic import PronySeries
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


class Softening(Effect):
    """Nonlinear part of the wall's response to contact forces at large displacements.

    It is a force on the modes that derives from a potential of their displacement, so it never returns more energy than
    it received. It vanishes at first order: the wall is linear for small loads. Weight and gas pressure do not soften
    it. It includes the energy of `nonlinear_membrane` and replaces that effect.
    """

    Settings = SofteningSettings
    of_wall = True
    n_local_modes = N_LOCAL_MODES
    stands_for = ("nonlinear_membrane",)
    can_rest = True

    def train(self, duct: ReducedDuct, progress: Progress) -> None:
        """Train the softening of the wall, unless it is in the cache.

        Raises ValueError if the surface encloses no lumen.
        """
        self._fetch(duct, progress)

    def prepare(self, world: World) -> None:
        """Build the softening wall."""
        from trocar.services.mechanics.reduction.softened_wall.softening_step import SofteningStep

        duct = world.duct
        # Read by name, so that no effect imports another.
        viscous = self.scene.effects.get("viscoelasticity")
        series = PronySeries(getattr(viscous, "g", ()), getattr(viscous, "tau_s", ()))
        softening, load = self._fetch(duct.reduced), duct.constant_modal_force
        self._wall = SofteningStep(duct.reduced, softening, load, duct.integrator, series)

    def add_loads(self, world: World, dt_s: float) -> None:
        """Apply the softening force to the modes."""
        world.duct.modal_force += self._wall.force

    def after_solve(self, world: World, dt_s: float) -> None:
        """Update the softening force from contact forces and modes."""
        duct, n = world.duct, world.duct.n_loads
        loads = duct.load_nodes[:n], duct.load_force_n[:n]
        motion = duct.state.q, duct.q_start, duct.state.qdot, duct.state.qddot
        drive = duct.modal_force, duct.position_gain * duct.contact_impulse
        self._wall.follow(loads, duct.contact_impulse, drive, motion, dt_s)
        self.dissipated_j = self._wall.dissipated_j

    def rest(self) -> None:
        """Begin to fade the softening out."""
        self._wall.fade(1.0)

    def wake(self) -> None:
        """Begin to fade the softening in."""
        self._wall.fade(0.0)

    @property
    def rests(self) -> bool:
        """Whether the wall is linear now."""
        return self._wall.has_faded

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the filtered contact forces, the force on the modes, and the energy balance."""
        return self._wall.state_arrays()

    def potential_energy_j(self, world: World) -> float:
        """Return the stored energy relative to a linear wall at the same displacement."""
        return self._wall.stored_j

    def _fetch(self, duct: ReducedDuct, progress: Progress = ignore_progress) -> WallSoftening:
        from trocar.services.mechanics.reduction.softening.training import fetch_softening

        recipe = recipe_of(duct, "softening")
        try:
            return fetch_softening(recipe, duct, self.settings.n_squeezes, duct.cache_dir, progress)
        except ValueError as error:
            raise ValueError(f"effects.softening: {error}") from error
