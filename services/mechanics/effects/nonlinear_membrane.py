"""Nonlinear membrane: the wall stiffens as it stretches."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, FloatArray
from trocar.services.mechanics.effects.base import Effect, recipe_of, require_positive
from trocar.services.mechanics.reduction.nonlinear.cubic_force import apply_impulse
from trocar.services.mechanics.reduction.nonlinear.quadratic_manifold import fetch_membrane_force
from trocar.services.mechanics.reduction.viscoelastic import PronySeries, ViscousModes
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.world import World

_APART = 1e-4
"""Of the largest coordinate: how far apart gradients are taken for a tangent."""


@dataclass(frozen=True, slots=True)
class NonlinearMembraneSettings:
    """Number of lowest modes in the polynomial; the cost grows with its fourth power."""

    n_coordinates: int = 12

    def __post_init__(self) -> None:
        require_positive(self, "n_coordinates")


class NonlinearMembrane(Effect):
    """Geometric stiffness of the wall as a cubic polynomial of the lowest modes, applied as a kick before the step.

    The splitting is symplectic: energy is bounded while the tangent stays below (2 / dt)^2. So steps are at most half
    as long as that; a power iteration that goes on from step to step finds the stiffest direction. The force derives
    from one polynomial energy, so it feeds in no energy on average.

    A viscoelastic wall has the energy (1 - sum g) W(q) + sum_k g_k W(q - d_k) with the energy W of the elastic one,
    which is never negative, and the lagging coordinates d_k of its modes. If only the linear part of W relaxed, the
    rest would exceed it where the wall is bent by some thicknesses, and the wall would snap.
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
        self._gradient, self._branch = np.zeros((2, duct.basis.n_modes))
        self._scratch = np.zeros((2, self.settings.n_coordinates))
        viscous = self.scene.effects.get("viscoelasticity")  # read by name, so that no effect imports another
        series = PronySeries(getattr(viscous, "g", ()), getattr(viscous, "tau_s", ()))
        self._lagging = ViscousModes(duct.basis.omega_rad_s, series)
        self._stiffest, self._ahead = np.zeros((2, duct.basis.n_modes))
        self._stiffest[self._force.coordinates] = 1.0 / math.sqrt(self.settings.n_coordinates)
        self._tangent_1_s2 = np.zeros(1)

    def add_loads(self, world: World, dt_s: float) -> None:
        """Kick the modes."""
        state = world.duct.state
        self._follow_stiffest(state.q)
        apply_impulse(state.qdot, state.qddot, self._gradient, self._damping, -dt_s)
        world.duct.modal_kick -= self._gradient

    def after_solve(self, world: World, dt_s: float) -> None:
        """Let the lagging coordinates follow the modes."""
        q, lagging = world.duct.state.q, self._lagging
        if len(lagging.g):
            behind = q - lagging.d
            lagging.relax(q, dt_s)
            for share, before, after in zip(lagging.g, behind, q - lagging.d, strict=True):
                self.dissipated_j += share * (self._force.energy_j(before) - self._force.energy_j(after))

    def state_arrays(self) -> tuple[AnyArray, ...]:
        """Return the power iteration and the lagging coordinates."""
        return self._stiffest, self._tangent_1_s2, *((self._lagging.d,) if len(self._lagging.g) else ())

    def longest_step_s(self) -> float:
        """Return half of the longest step at which the kick is stable."""
        tangent = float(self._tangent_1_s2[0])
        return 1.0 / math.sqrt(tangent) if tangent > 0.0 else math.inf

    def potential_energy_j(self, world: World) -> float:
        """Return the energy of the polynomial."""
        q, lagging = world.duct.state.q, self._lagging
        branches_j = sum(share * self._force.energy_j(q - d) for share, d in zip(lagging.g, lagging.d, strict=True))
        return lagging.long_term * self._force.energy_j(q) + float(branches_j)

    def _follow_stiffest(self, q: FloatArray) -> None:
        """Write the gradient at q (r,), and take one step of the power iteration on the tangent there."""
        apart = _APART * max(float(np.abs(q).max()), _APART)
        np.multiply(self._stiffest, apart, out=self._ahead)
        self._ahead += q
        self._write_gradient(self._ahead)
        self._ahead[:] = self._gradient
        self._write_gradient(q)
        self._ahead -= self._gradient
        size = float(np.linalg.norm(self._ahead))
        self._tangent_1_s2[0] = size / apart
        if size > 0.0:
            np.divide(self._ahead, size, out=self._stiffest)

    def _write_gradient(self, q: FloatArray) -> None:
        gradient, branch, lagging = self._gradient, self._branch, self._lagging
        gradient[:] = 0.0
        self._force.add_force(q, gradient, self._scratch)
        if len(lagging.g):
            gradient *= lagging.long_term
            for share, d in zip(lagging.g, lagging.d, strict=True):
                branch[:] = 0.0
                self._force.add_force(q - d, branch, self._scratch)
                gradient += share * branch
