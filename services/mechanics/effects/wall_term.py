"""An effect that is a term of the wall's potential: all of them take one step together."""

from __future__ import annotations

from trocar.services.mechanics.arrays import AnyArray
from trocar.services.mechanics.bodies.wall_terms import WallTerms, terms_of
from trocar.services.mechanics.effects.base import Effect
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import BeyondLinear
from trocar.services.mechanics.world import World


class WallTerm(Effect):
    """Base of such effects: `prepare` brings the term by `take_terms`.

    The force is the mean slope of the potential over the step, so it does the work of that at any step. Where the wall
    is viscoelastic all terms relax by the same series as the linear wall. The first of a scene's terms tells the energy
    of all of them.
    """

    of_wall, acts_for_all = True, True

    @property
    def stretch_law(self) -> BeyondLinear | None:
        """Law whose stretched wall needs modes, see `reduction.hyperelastic.stretched_states`; none by default."""
        return None

    def take_terms(self, world: World) -> WallTerms:
        """Return the terms of the wall."""
        self._terms = terms = terms_of(world.duct)
        self._is_first = not terms.is_kept
        terms.is_kept = True
        return terms

    def add_loads(self, world: World, dt_s: float) -> None:
        """Hold the mean force of the wall's terms over the step."""
        self._terms.hold(dt_s)

    def settle(self, world: World, dt_s: float) -> None:
        """Remove the energy gained in the step because its contact forces differed from those of the last step."""
        self._terms.settle(lambda: world.clearance_m, dt_s)

    def after_solve(self, world: World, dt_s: float) -> None:
        """Let the pattern of the loads follow these; a wall that relaxes does that itself, see `Viscoelasticity`."""
        if world.duct.viscous is None:
            self._terms.end_step(dt_s)

    @property
    def dissipated_j(self) -> float:
        """Energy that steps of the terms have lost, and relaxation beyond that of the linear wall."""
        return self._terms.dissipated_j if self._is_first else 0.0

    @property
    def is_settled(self) -> bool:
        """Whether the step owes no more energy than a small part of what is stored."""
        return self._terms.is_settled

    def potential_energy_j(self, world: World) -> float:
        """Return the energy of all terms beyond that of a linear wall, unless another effect does."""
        return self._terms.energy_j() if self._is_first else 0.0

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the state of the wall's terms, unless another effect does."""
        return self._terms.state_arrays() if self._is_first else ()
