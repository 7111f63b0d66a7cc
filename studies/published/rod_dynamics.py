"""Free motions of the example rod: how far a step of given length and numerical damping is off in them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.rod import ImplicitIntegrator, RodState, clamped, rod_energy, straight_rod
from trocar.studies.published.rods import EI, LENGTH_M, X, example_rod, step_to_rest

CATHETER_DAMPING_S = 2e-4  # of the material of a scene's catheter


def bent_by_tip_load(deflection: float = 0.18) -> FloatArray:
    """Particles (n, 3) of a cantilever at rest under a tip load that, by linear theory, bends it by that share of L."""
    properties = example_rod(internal_damping_s=0.02, viscous_drag_n_s_m2=0.05)
    state = straight_rod(properties, (0, 0, 0), X)
    load = np.zeros_like(state.position_m)
    load[-1, 2] = -3.0 * deflection * EI / LENGTH_M**2
    step_to_rest(ImplicitIntegrator(properties, clamped(X)), state, load, dt_s=2e-3, speed_m_s=1e-9)
    return state.position_m


def released_tip(
    bent_m: FloatArray, dt_s: float, spectral_radius: float, *, duration_s: float = 0.3, every_s: float = 1e-3
) -> FloatArray:
    """Tip (k, 3), every ``every_s``, of a cantilever let go at rest from the particles ``bent_m`` (n, 3)."""
    properties = example_rod(internal_damping_s=CATHETER_DAMPING_S)
    integrator = ImplicitIntegrator(properties, clamped(X), spectral_radius=spectral_radius)
    state = RodState(bent_m.copy(), np.zeros_like(bent_m))
    no_load, per_sample = np.zeros_like(bent_m), round(every_s / dt_s)
    tip = np.empty((round(duration_s / every_s), 3))
    for row in tip:
        for _ in range(per_sample):
            integrator.predict(state, no_load, dt_s)
        row[:] = state.position_m[-1]
    return tip


def tip_errors_m(steps_s: tuple[float, ...], spectral_radius: float, finest_s: float = 1e-5) -> FloatArray:
    """Root mean square error of a released cantilever's tip over 0.3 s, against a step of ``finest_s``."""
    bent_m = bent_by_tip_load()
    reference = released_tip(bent_m, finest_s, 1.0)
    apart = [released_tip(bent_m, dt_s, spectral_radius) - reference for dt_s in steps_s]
    return np.array([np.sqrt(np.mean(np.sum(d**2, axis=1))) for d in apart])


class Spin(NamedTuple):
    """What half a second has done to a free rod that spins about its middle.

    Attributes:
        momentum: Angular momentum over that at the start.
        energy: Kinetic and elastic energy over that at the start, after every step.
    """

    momentum: float
    energy: FloatArray


def spin(rate_rad_s: float, spectral_radius: float, dt_s: float = 1e-3, duration_s: float = 0.5) -> Spin:
    """Let a straight, undamped rod spin freely across its axis."""
    properties = example_rod()
    integrator = ImplicitIntegrator(properties, spectral_radius=spectral_radius)
    state = straight_rod(properties, (-0.5 * LENGTH_M, 0, 0), X)
    state.velocity_m_s[:, 1] = rate_rad_s * state.position_m[:, 0]
    state.slow_velocity_m_s = state.velocity_m_s.copy()  # smooth: nothing for a first step to damp
    mass = properties.particle_mass_kg()
    no_load = np.zeros_like(state.position_m)

    def momentum() -> float:
        return float(np.cross(state.position_m, mass[:, None] * state.velocity_m_s)[:, 2].sum())

    start, start_j = momentum(), rod_energy(integrator.model, state).total_j
    energy_j = []
    for _ in range(round(duration_s / dt_s)):
        integrator.predict(state, no_load, dt_s)
        energy_j.append(rod_energy(integrator.model, state).total_j)
    return Spin(momentum() / start, np.array(energy_j) / start_j)
