"""Nothing damped, nothing touched, a million steps: the energy of rod and wall may not grow."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import partial

import numpy as np

from trocar.services.mechanics.reduction import ExactOscillator, ModalState, Newmark
from trocar.services.mechanics.rod import ImplicitIntegrator, clamped, rod_energy, straight_rod
from trocar.studies.published.rods import X, example_rod
from trocar.studies.stability.drive import Driven
from trocar.studies.stability.family import Case, Draw

STEPS = 1_000_000
LOOK_EVERY = 1000
SPEEDS_M_S = 1e-3, 0.1, 1.0
STEPS_S = 1e-4, 1e-3


def cases(draw: Draw) -> Iterator[Case]:
    """A cantilever struck softly and hard, and all modes of a wall at once, with both integrators."""
    steps = STEPS if draw.is_long else 500
    for speed in SPEEDS_M_S if draw.is_long else (1.0,):
        for dt_s in STEPS_S if draw.is_long else (1e-3,):
            yield Case(f"rod struck at {speed:g} m/s, {1e3 * dt_s:g} ms", partial(_rod, speed, dt_s, steps))
    for kind in (Newmark, ExactOscillator):
        yield Case(f"wall, {kind.__name__}", partial(_wall, kind, steps))


def _rod(speed_m_s: float, dt_s: float, steps: int) -> Driven:
    properties = example_rod(20)
    integrator, state = ImplicitIntegrator(properties, clamped(X)), straight_rod(properties, (0, 0, 0), X)
    no_load = np.zeros((properties.n_particles, 3))
    state.velocity_m_s[1:] = speed_m_s * np.random.default_rng(1).normal(size=(properties.n_segments, 3))
    first_j = rod_energy(integrator.model, state).total_j
    highest_j = first_j
    for step in range(steps):
        integrator.predict(state, no_load, dt_s)
        if step % LOOK_EVERY == 0:
            highest_j = max(highest_j, rod_energy(integrator.model, state).total_j)
    return _driven(highest_j / first_j - 1.0, state.position_m.tobytes(), steps)


def _wall(kind: type[Newmark | ExactOscillator], steps: int) -> Driven:
    omega = np.geomspace(10.0, 1e5, 60)
    integrator, state, no_load = kind(omega, np.zeros(60)), ModalState.at_rest(60), np.zeros(60)
    state.qdot[:] = np.random.default_rng(1).normal(size=60)
    energies_j = 0.5 * state.qdot**2
    highest = np.zeros(60)
    for step in range(steps):
        integrator.predict(state, no_load, 1e-3)
        if step % LOOK_EVERY == 0:
            now_j = 0.5 * (state.qdot**2 + (omega * state.q) ** 2)
            highest = np.maximum(highest, now_j / energies_j - 1.0)
    return _driven(float(highest.max()), state.q.tobytes(), steps)


def _driven(drift: float, state: bytes, steps: int) -> Driven:
    return Driven({"drift": drift}, hashlib.blake2b(state, digest_size=8).hexdigest(), steps)
