"""An effect that is a term of the wall's potential: all of them take one step together."""

from __future__ import annotations

from trocar.services.mechanics.arrays import AnyArray
from trocar.services.mechanics.bodies.wall_terms import HOLD, RELAX, SETTLE, WallTerms, terms_of
from trocar.services.mechanics.effects.base import Effect
from trocar.services.mechanics.reduction.viscoelastic import PronySeries
from trocar.services.mechanics.reduction.wall_step.implicit_step import ENERGY
from trocar.services.mechanics.world import World


class WallTerm(Effect):
    """Base of such effects: `prepare` brings the term by `take_terms`; `potential_energy_j` tells its energy.

    The force is the mean slope of the potential over the step, so it does the work of that at any step. Where the wall
    is viscoelastic the term relaxes by the same series as the linear wall.
    """

    of_wall = True

    def take_terms(self, world: World) -> WallTerms:
        """Return the terms of the wall, which relax as the scene says."""
        self._terms = terms = terms_of(world.duct)
        viscous = self.scene.effects.get("viscoelasticity")  # read by name, so that no effect imports another
        terms.series = PronySeries(getattr(viscous, "g", ()), getattr(viscous, "tau_s", ()))
        self._keeps_state = not terms.is_kept
        terms.is_kept = True
        return terms

    def add_loads(self, world: World, dt_s: float) -> None:
        """Hold the mean force of the wall's terms over the step."""
        if self._terms.enters(HOLD):
            self._terms.hold(dt_s)

    def settle(self, world: World, dt_s: float) -> None:
        """Remove the energy gained in the step because its contact forces differed from those of the last step."""
        if self._terms.enters(SETTLE):
            self.dissipated_j += self._terms.settle(world.clearance_m, dt_s)

    def take_back(self, world: World, share: float) -> None:
        """Note the energy of the wall where it is now."""
        self._terms.step.books[ENERGY] = self._terms.energy_j()

    def after_solve(self, world: World, dt_s: float) -> None:
        """Let the wall's terms relax."""
        if self._terms.enters(RELAX):
            self.dissipated_j += self._terms.relax(dt_s)

    @property
    def is_settled(self) -> bool:
        """Whether the step owes no more energy than a small part of what is stored."""
        return self._terms.is_settled

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the state of the wall's terms, unless another effect does."""
        return self._terms.state_arrays() if self._keeps_state else ()
