"""Hyperelasticity: tissue that stiffens as it is stretched, by Fung's exponential membrane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import AnyArray
from trocar.services.mechanics.effects.base import Effect, recipe_of, require_positive
from trocar.services.mechanics.reduction.build import Progress, ignore_progress
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import StretchSamples, fetch_samples
from trocar.services.mechanics.reduction.hyperelastic.energy_tank import CREDIT_J, MOST_OWED, settle_step
from trocar.services.mechanics.reduction.hyperelastic.hyperelastic_wall import (
    ENERGY,
    TANK,
    HyperelasticWall,
    stretch_energy,
    stretch_force,
)
from trocar.services.mechanics.reduction.modal_state import ModalState
from trocar.services.mechanics.reduction.nonlinear.cubic_force import apply_impulse
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.world import World


@dataclass(frozen=True, slots=True)
class HyperelasticitySettings:
    """Exponent a of Fung's law: at a uniaxial stretch e the wall is exp(a e^2) times as stiff as at rest.

    Arteries have about 1, up to strains of 1 (rabbit carotid, b1 = 0.99: Chuong and Fung, Journal of Biomechanical
    Engineering 105:268, 1983). Bile ducts stiffen exponentially too, but already within a stretch of 0.1 to 0.25 (Duch
    2004), which needs a larger exponent; 20 is an assumption.
    """

    exponent: float = 20.0

    def __post_init__(self) -> None:
        require_positive(self, "exponent")


class Hyperelasticity(Effect):
    """The wall's membrane stiffens with its linear strain in the modes, which include those of the stretched wall.

    The residual beyond the modes stays linear. The force is the gradient of a convex energy that begins with the fourth
    power of the strain, so the wall is linear for small loads. It is implicit, hence stable however stiff the wall is.
    """

    Settings = HyperelasticitySettings
    of_wall = True
    kicks = True
    can_rest = True
    stretch_modes = True

    def train(self, duct: ReducedDuct, progress: Progress) -> None:
        """Choose the triangles that sample the wall, unless they are in the cache."""
        self._fetch(duct, progress)

    def prepare(self, world: World) -> None:
        """Build the hyperelastic wall, at rest."""
        duct = world.duct.reduced
        self._wall = HyperelasticWall.of(self._fetch(duct))
        self._damping = 2.0 * duct.basis.omega_rad_s * duct.damping_ratio
        self._ahead = ModalState.at_rest(duct.basis.n_modes)
        self._force = np.zeros(duct.basis.n_modes)
        self._wall.books[ENERGY] = self.potential_energy_j(world)
        self._dt_s = 0.0
        self._to_fade = 0.0

    def add_loads(self, world: World, dt_s: float) -> None:
        """Kick the modes by the force at the end of the step."""
        duct, ahead = world.duct, self._ahead
        if dt_s != self._dt_s:
            self._wall.take_gain(duct.position_gain)
            self._dt_s = dt_s
        ahead.q[:], ahead.qdot[:], ahead.qddot[:] = duct.state.q, duct.state.qdot, duct.state.qddot
        duct.integrator.predict(ahead, duct.modal_force, dt_s)
        stretch_force(self._wall.address, ahead.q, duct.contact_impulse, self._force)
        apply_impulse(duct.state.qdot, duct.state.qddot, self._force, self._damping, dt_s)
        duct.modal_kick += self._force

    def settle(self, world: World, dt_s: float) -> None:
        """Remove the energy gained in the step because its contact forces differed from those of the last step."""
        settle_step(self._wall, self._force, world.duct, world.clearance_m)
        if self._wall.faded[0] != self._to_fade:
            self._wall.fade(self._to_fade, dt_s)
            self._wall.books[ENERGY] = self.potential_energy_j(world)

    @property
    def is_settled(self) -> bool:
        """Whether the step owes no more energy than `MOST_OWED` of what is stored."""
        books = self._wall.books
        return bool(books[TANK] >= -CREDIT_J - MOST_OWED * books[ENERGY])

    def rest(self) -> None:
        """Begin to fade the stiffening out."""
        self._to_fade = 1.0

    def wake(self) -> None:
        """Begin to fade the stiffening in."""
        self._to_fade = 0.0

    @property
    def rests(self) -> bool:
        """Whether the wall does not stiffen at all."""
        return float(self._wall.faded[0]) == 1.0

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the force at the start of the next step, and the energy balance of the steps."""
        return self._wall.state_arrays()

    def potential_energy_j(self, world: World) -> float:
        """Return the energy stored beyond that of a linear wall."""
        return stretch_energy(self._wall.address, world.duct.state.q)

    def _fetch(self, duct: ReducedDuct, progress: Progress = ignore_progress) -> StretchSamples:
        recipe = recipe_of(duct, "hyperelasticity")
        return fetch_samples(recipe, duct.basis, self.settings.exponent, duct.cache_dir, progress)
