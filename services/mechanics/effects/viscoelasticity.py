"""Viscoelastic wall: a Prony series on every mode of the duct."""

from __future__ import annotations

from dataclasses import dataclass

from services.mechanics.arrays import FloatArray
from services.mechanics.effects.base import Effect
from services.mechanics.reduction.viscoelastic import PronySeries, ViscousModes
from services.mechanics.world import World


@dataclass(frozen=True, slots=True)
class ViscoelasticitySettings:
    """Shares and times of the Prony terms: an assumption, no duct data is in print."""

    g: tuple[float, ...] = (0.2, 0.15, 0.1)
    tau_s: tuple[float, ...] = (0.1, 1.0, 10.0)

    def __post_init__(self) -> None:
        self.series()

    def series(self) -> PronySeries:
        """Return the terms; ValueError where they make no sense."""
        return PronySeries(self.g, self.tau_s)


class Viscoelasticity(Effect):
    """The duct's modulus is the instantaneous one and relaxes by sum(g); what the modes leave out stays elastic.

    Dissipative at any step. The lagging coordinates are the effect's own state.
    """

    Settings = ViscoelasticitySettings
    of_wall = True

    def prepare(self, world: World) -> None:
        """Start relaxed."""
        self._modes = ViscousModes(world.duct.reduced.basis.omega_rad_s, self.settings.series())

    def add_loads(self, world: World, dt_s: float) -> None:
        """Drive the modes with what the wall has relaxed."""
        self._modes.add_force(world.duct.modal_force)

    def after_solve(self, world: World, dt_s: float) -> None:
        """Let the wall relax towards where it is."""
        self._modes.relax(world.duct.state.q, dt_s)
        self.dissipated_j = self._modes.dissipated_j

    def state_arrays(self) -> tuple[FloatArray, ...]:
        """The lagging coordinates."""
        return (self._modes.d,)

    def potential_energy_j(self, world: World) -> float:
        """Energy in the springs of the Prony terms less that of the instantaneous modulus, which the duct reports."""
        duct = world.duct
        unrelaxed_j = duct.state.strain_energy_j(duct.reduced.basis.omega_rad_s)
        return self._modes.stored_energy_j(duct.state.q) - unrelaxed_j
