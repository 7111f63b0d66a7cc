"""Prony series on modes: closed forms of relaxation, creep and hysteresis; dissipation is never negative."""

import numpy as np
import pytest

from trocar.services.mechanics.reduction import ExactOscillator, ModalState, Newmark
from trocar.services.mechanics.reduction.viscoelastic import PronySeries, ViscousModes

SERIES = PronySeries((0.2, 0.15, 0.1), (0.1, 1.0, 10.0))
OMEGA = 2.0 * np.pi * np.array([9.0, 42.0, 150.0])


@pytest.mark.parametrize("dt_s", [1e-3, 0.05, 2.0])
def test_held_deflection_relaxes_as_the_closed_form_at_any_step(dt_s):
    modes, q = ViscousModes(OMEGA, SERIES), np.array([1.0, -0.5, 2.0])
    for step in range(1, 30):
        modes.relax(q, dt_s)
        relaxed = np.zeros(3)
        modes.add_force(relaxed)
        expected = OMEGA**2 * q * SERIES.relaxation(np.array([step * dt_s]))
        assert OMEGA**2 * q - relaxed == pytest.approx(expected, rel=1e-12)


def test_held_load_creeps_as_the_standard_linear_solid():
    g, tau, omega, dt_s = 0.4, 0.2, np.array([2.0 * np.pi * 200.0]), 1e-3
    modes, step = ViscousModes(omega, PronySeries((g,), (tau,))), ExactOscillator(omega, np.full(1, 0.3))
    state, load = ModalState.at_rest(1), np.array([3.0])
    load_time_s = np.arange(1, 1001) * dt_s
    history = []
    for _ in load_time_s:
        force = load.copy()
        modes.add_force(force)
        step.predict(state, force, dt_s)
        modes.relax(state.q, dt_s)
        history.append(state.q[0])
    creep = load / omega**2 * (1.0 + g / (1.0 - g) * (1.0 - np.exp(-load_time_s * (1.0 - g) / tau)))
    settled = load_time_s > 0.05
    assert np.array(history)[settled] == pytest.approx(creep[settled], rel=0.01)


@pytest.mark.parametrize("frequency_hz", [0.2, 1.0, 5.0])
def test_a_cycle_dissipates_what_the_loss_modulus_says(frequency_hz):
    series, amplitude, cycle = PronySeries((0.2, 0.15), (0.1, 1.0)), 0.01, 1000
    modes, dt_s = ViscousModes(OMEGA[:1], series), 1.0 / (cycle * frequency_hz)
    angular = 2.0 * np.pi * frequency_hz
    warm_up = int(np.ceil(6.0 * frequency_hz))
    lost_before = 0.0
    for step in range((warm_up + 1) * cycle):
        if step == warm_up * cycle:
            lost_before = modes.dissipated_j
        modes.relax(np.array([amplitude * np.sin(angular * dt_s * (step + 1))]), dt_s)
    loss = sum(g * angular * tau / (1.0 + (angular * tau) ** 2) for g, tau in zip(series.g, series.tau_s, strict=True))
    expected = np.pi * OMEGA[0] ** 2 * loss * amplitude**2
    assert modes.dissipated_j - lost_before == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("integrator", [ExactOscillator, Newmark])
def test_energy_falls_by_exactly_what_is_dissipated_and_never_rises(integrator):
    rng = np.random.default_rng(12)
    modes, step = ViscousModes(OMEGA, SERIES), integrator(OMEGA, np.zeros(3))
    state = ModalState(rng.standard_normal(3) / OMEGA, rng.standard_normal(3), np.zeros(3))
    state.qddot[:] = -(OMEGA**2) * state.q
    start = state.kinetic_energy_j() + modes.stored_energy_j(state.q)
    energies, force, previous = [start], np.zeros(3), np.zeros(3)
    for _ in range(5000):
        force[:] = 0.0
        modes.add_force(force)
        # Newmark averages the accelerations at both ends: let the start see the force of this step too.
        state.qddot += force - previous
        previous[:] = force
        step.predict(state, force, 1e-3)
        modes.relax(state.q, 1e-3)
        energies.append(state.kinetic_energy_j() + modes.stored_energy_j(state.q))
    assert np.diff(energies).max() <= 1e-12 * start
    assert energies[-1] + modes.dissipated_j == pytest.approx(start, rel=1e-9)
    assert energies[-1] < 0.9 * start


@pytest.mark.parametrize(
    ("g", "tau_s", "message"),
    [((0.2,), (0.1, 1.0), "do not fit"), ((0.6, 0.4), (0.1, 1.0), "less than 1"), ((0.1,), (0.0,), "times must be")],
)
def test_series_that_make_no_sense_are_refused(g, tau_s, message):
    with pytest.raises(ValueError, match=message):
        PronySeries(g, tau_s)
