"""Newmark and the exact oscillator against closed forms, conservation laws and each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from scipy.integrate import solve_ivp

from trocar.services.mechanics.reduction import ExactOscillator, ModalState, Newmark
from trocar.services.mechanics.reduction.newmark import newmark_step
from trocar.services.mechanics.reduction.oscillator import oscillator_step
from trocar.studies.full_model import NewmarkConstants

OMEGA = 2.0 * np.pi * np.array([9.03, 42.7, 140.0, 950.0])
DT_S = 1e-3
INTEGRATORS = [Newmark, ExactOscillator]


def test_newmark_constants_are_those_of_appendix_b():
    a = NewmarkConstants.from_step(0.5, 3.0)
    assert (a.a0, a.a1, a.a2, a.a3) == (28.0, 28.0, 11.0, 1.0)
    assert (a.a4, a.a5, a.a6, a.a7) == (16.0, -16.0, -8.0, -1.0)
    assert (a.a8, a.a9, a.a10) == (0.25, 0.0625, 0.0625)


def test_newmark_satisfies_equilibrium_at_the_end_of_the_step():
    rng = np.random.default_rng(1)
    zeta, force = np.array([0.0, 0.02, 0.3, 1.4]), rng.standard_normal(4)
    state = ModalState(*rng.standard_normal((3, 4)))
    Newmark(OMEGA, zeta).predict(state, force, DT_S)
    balance = state.qddot + 2.0 * zeta * OMEGA * state.qdot + OMEGA**2 * state.q - force
    assert np.abs(balance).max() < 1e-9 * np.abs(OMEGA**2 * state.q).max()


def test_newmark_period_error_is_the_known_one():
    omega = 2.0 * np.pi * 40.0
    state = ModalState(np.ones(1), np.zeros(1), np.full(1, -(omega**2)))
    integrator, steps = Newmark(np.array([omega]), np.zeros(1)), 4000
    signal = np.empty(steps)
    for i in range(steps):
        integrator.predict(state, np.zeros(1), DT_S)
        signal[i] = state.q[0]
    phase = np.arccos(np.clip(signal[0], -1.0, 1.0))
    assert omega * DT_S / phase - 1.0 == pytest.approx((omega * DT_S) ** 2 / 12.0, rel=0.02)


#: What is smaller has an energy that doubles hold with a few bits only.
numbers = st.floats(-1.0, 1.0).map(lambda number: number if abs(number) > 1e-100 else 0.0)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@settings(max_examples=50)
@given(
    hz=st.floats(0.5, 2e4), dt_s=st.floats(1e-5, 0.05), zeta=st.just(0.0) | st.floats(0.0, 5.0), q=numbers, rate=numbers
)
def test_a_free_mode_keeps_its_energy_and_a_damped_one_gains_none(integrator, hz, dt_s, zeta, q, rate):
    omega = np.array([2.0 * np.pi * hz])
    state = ModalState(np.array([q]) / omega, np.array([rate]), np.zeros(1))
    state.qddot[:] = -2.0 * zeta * omega * state.qdot - omega**2 * state.q
    scheme, force = integrator(omega, np.array([zeta])), np.zeros(1)

    def energy():
        return float(0.5 * (state.qdot**2 + (omega * state.q) ** 2)[0])

    began, steps = energy(), 30
    # A step far longer than a period adds and takes away (omega dt)^2 times what stays: so much larger is its rounding.
    rounding = max(1e-9, 2.0 * steps * np.finfo(float).eps * float(omega[0] * dt_s) ** 2)
    for _ in range(steps):
        scheme.predict(state, force, dt_s)
        if zeta == 0.0:
            assert energy() == pytest.approx(began, rel=rounding, abs=1e-300)
        else:
            assert energy() <= began * (1.0 + rounding)


@njit
def _run(step, q, qdot, qddot, constants, dt, steps):
    force = np.zeros_like(q)
    for _ in range(steps):
        step(q, qdot, qddot, force, constants, dt)


def _energy(state):
    return 0.5 * (state.qdot**2 + (OMEGA * state.q) ** 2)


def test_undamped_newmark_keeps_its_energy_over_a_million_steps():
    state = ModalState(1.0 / OMEGA, np.array([0.3, -0.2, 0.5, 0.1]), -OMEGA)
    integrator = Newmark(OMEGA, np.zeros(4))
    integrator.gains(DT_S)
    before = _energy(state)
    _run(newmark_step, state.q, state.qdot, state.qddot, integrator._kernel_constants, DT_S, 1_000_000)
    drift = np.abs(_energy(state) / before - 1.0)
    print(f"relative energy drift after 1e6 steps: {drift}")
    assert drift.max() < 1e-10


@njit
def _run_exact(q, qdot, qddot, transition, steps):
    force = np.zeros_like(q)
    for _ in range(steps):
        oscillator_step(q, qdot, qddot, force, transition)


def test_undamped_exact_oscillator_is_in_phase_after_a_million_steps():
    state = ModalState(1.0 / OMEGA, np.zeros(4), -OMEGA)
    integrator, steps = ExactOscillator(OMEGA, np.zeros(4)), 1_000_000
    integrator.gains(DT_S)
    _run_exact(state.q, state.qdot, state.qddot, integrator._transition, steps)
    assert state.q * OMEGA == pytest.approx(np.cos(OMEGA * DT_S * steps), abs=1e-8)
    assert np.abs(2.0 * _energy(state) - 1.0).max() < 1e-9


@pytest.mark.parametrize("zeta", [0.0, 0.05, 0.999999, 1.0, 1.000001, 3.0, 500.0])
def test_exact_oscillator_solves_the_differential_equation(zeta):
    omega, force = 2.0 * np.pi * 60.0, 2.5e3
    state = ModalState(np.array([0.02]), np.array([-4.0]), np.zeros(1))
    integrator = ExactOscillator(np.array([omega]), np.array([zeta]))
    for _ in range(7):
        integrator.predict(state, np.array([force]), DT_S)

    def rate(_, y):
        return [y[1], force - 2.0 * zeta * omega * y[1] - omega**2 * y[0]]

    reference = solve_ivp(rate, (0.0, 7 * DT_S), [0.02, -4.0], method="Radau", rtol=1e-11, atol=1e-13)
    assert state.q[0] == pytest.approx(reference.y[0, -1], rel=1e-7)
    assert state.qdot[0] == pytest.approx(reference.y[1, -1], rel=1e-6, abs=1e-7)
    assert state.qddot[0] == pytest.approx(rate(0, [state.q[0], state.qdot[0]])[1], rel=1e-9)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_prediction_then_correction_is_one_step_under_both_forces(integrator):
    rng = np.random.default_rng(2)
    zeta = np.array([0.0, 0.05, 1.0, 2.0])
    free, contact = rng.standard_normal((2, 4))
    together, apart = (ModalState(*np.ones((3, 4))) for _ in range(2))
    scheme = integrator(OMEGA, zeta)
    scheme.predict(together, free + contact, DT_S)
    scheme.predict(apart, free, DT_S)
    gains = scheme.gains(DT_S)
    apart.q += gains.position * contact
    apart.qdot += gains.velocity * contact
    apart.qddot += gains.acceleration * contact
    for name in ("q", "qdot", "qddot"):
        assert getattr(apart, name) == pytest.approx(getattr(together, name), rel=1e-9)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_damped_modes_settle_at_the_static_answer(integrator):
    zeta, force = np.array([0.05, 0.1, 0.7, 2.0]), np.array([1.0, -2.0, 3.0, 4.0])
    state, scheme = ModalState.at_rest(4), integrator(OMEGA, zeta)
    for _ in range(5000):
        scheme.predict(state, force, DT_S)
    assert state.q == pytest.approx(force / OMEGA**2, rel=1e-6)


@pytest.mark.parametrize(("integrator", "order"), [(Newmark, 2.0), (ExactOscillator, np.inf)])
def test_order_of_accuracy_in_free_vibration(integrator, order):
    omega, zeta, end_s = np.array([2.0 * np.pi * 20.0]), np.array([0.03]), 0.05
    damped = omega * np.sqrt(1.0 - zeta**2)
    exact = np.exp(-zeta * omega * end_s) * (np.cos(damped * end_s) + zeta * omega / damped * np.sin(damped * end_s))
    errors = []
    for steps in (50, 100):
        state = ModalState(np.ones(1), np.zeros(1), -(omega**2))
        for _ in range(steps):
            integrator(omega, zeta).predict(state, np.zeros(1), end_s / steps)
        errors.append(abs(float((state.q - exact)[0])))
    if np.isinf(order):
        assert max(errors) < 1e-12
    else:
        assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)


def test_a_step_length_of_zero_is_refused():
    with pytest.raises(ValueError, match="time step must be positive"):
        Newmark(OMEGA, np.zeros(4)).gains(0.0)
