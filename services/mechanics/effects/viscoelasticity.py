"""Viscoelastic wall: a Prony series on every mode of the duct."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import AnyArray
from trocar.services.mechanics.bodies.wall_terms import terms_of
from trocar.services.mechanics.effects.base import Effect
from trocar.services.mechanics.reduction.viscoelastic import PronySeries, ViscousModes
from trocar.services.mechanics.reduction.viscous_loads import ViscousLoads
from trocar.services.mechanics.world import World


@dataclass(frozen=True, slots=True)
class ViscoelasticitySettings:
    """Shares and times of the Prony terms; an assumption, as no data of ducts is published."""

    g: tuple[float, ...] = (0.2, 0.15, 0.1)
    tau_s: tuple[float, ...] = (0.1, 1.0, 10.0)

    def __post_init__(self) -> None:
        self.series()

    def series(self) -> PronySeries:
        """Return the terms; ValueError where they make no sense."""
        return PronySeries(self.g, self.tau_s)


class Viscoelasticity(Effect):
    """The duct's modulus is the instantaneous one and relaxes by sum(g), in the modes and in the residual beyond them.

    It is dissipative at any step. The lagging coordinates and loads are the effect's own state, and turn with the wall.
    """

    Settings = ViscoelasticitySettings
    of_wall = True

    def prepare(self, world: World) -> None:
        """Start in the relaxed state."""
        duct, series = world.duct, self.settings.series()
        self._modes = duct.viscous = ViscousModes(duct.reduced.basis.omega_rad_s, series)
        self._loads = ViscousLoads(series, duct.reduced.mesh.n_vertices, len(duct.load_nodes))
        duct.viscous_loads, self._terms = self._loads, terms_of(duct)
        self._motion_m = np.zeros_like(duct.motion_m)

    def add_loads(self, world: World, dt_s: float) -> None:
        """Load the modes with the relaxed part of the wall's stress."""
        self._terms.hold_relaxed()

    def add_motion(self, world: World, dt_s: float) -> None:
        """Add the displacement by lagging loads to the free motion, which is without contact forces."""
        nodes, weights = world.system.rows.on_duct
        lasting, motion_m = self._loads.lasting, self._motion_m[: len(nodes)]
        if len(nodes) and len(lasting[0]):
            motion_m[:] = 0.0
            world.duct.add_load_displacement(nodes, weights, lasting, motion_m)
            world.system.add_duct_motion(motion_m)

    def after_solve(self, world: World, dt_s: float) -> None:
        """Relax the lagging state towards the wall's present state."""
        self._terms.end_step(dt_s)
        self._dissipated_j = self._modes.dissipated_j

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the lagging coordinates and loads."""
        return self._modes.d, self._terms.held_relaxed, *self._loads.state_arrays()

    def step_arrays(self) -> tuple[AnyArray, ...]:
        """Return the same without the loads, of which only those that lag are saved."""
        return self._modes.d, self._terms.held_relaxed

    @property
    def restartable(self) -> ViscousLoads:
        """The loads that lag."""
        return self._loads

    def potential_energy_j(self, world: World) -> float:
        """Return the energy in the Prony springs less that of the instantaneous modulus, which the duct reports."""
        duct = world.duct
        unrelaxed_j = duct.state.strain_energy_j(duct.reduced.basis.omega_rad_s)
        lagging_j = self._loads.extra_energy_j(duct.reduced.residual.store)
        return self._modes.stored_energy_j(duct.state.q) - unrelaxed_j + lagging_j
