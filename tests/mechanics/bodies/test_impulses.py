"""What contacts put into the wall is paid by whoever presses: impulses at the start of a step swing fast modes."""

import numpy as np
import pytest

from tests.mechanics.reduction.conftest import basis, duct, model  # noqa: F401  a tube of 620 nodes
from trocar.services.mechanics.bodies.duct import DuctBody
from trocar.services.mechanics.reduction.newmark import Newmark
from trocar.services.mechanics.reduction.oscillator import ExactOscillator

STEPS = 400
DT_S = 1e-3
PLACES = np.array([[200, 201, 221], [310, 311, 331]], np.int32)
WEIGHTS = np.full((2, 3), 1.0 / 3.0)


def press(body, forces):
    """Press two places with ``forces`` (t, 2, 3) in N and return energy and work done, both (t,), in J."""
    energy, work, done = [], [], 0.0
    residual_j = _residual_j(body)
    for force in forces:
        body.predict(DT_S)
        start = body.q_start.copy()
        body.gather(PLACES, WEIGHTS)
        body.correct(PLACES, WEIGHTS, force)
        done += float(body.contact_impulse @ (body.state.q - start))
        energy.append(body.kinetic_energy_j() + body.strain_energy_j() - _residual_j(body) + residual_j)
        work.append(done)
    return np.array(energy), np.array(work)


def _residual_j(body):
    return body.strain_energy_j() - body.state.strain_energy_j(body.reduced.basis.omega_rad_s)


@pytest.fixture(params=[Newmark, ExactOscillator], ids=lambda integrator: integrator.__name__)
def body(request, duct):  # noqa: F811
    return DuctBody(duct, request.param(duct.basis.omega_rad_s, duct.damping_ratio), capacity=4)


@pytest.mark.parametrize("kind", ["alternating", "random", "growing"])
def test_no_force_puts_in_more_than_its_work(body, kind):
    """Before, forces that alternate from step to step put in up to three times their work."""
    random = np.random.default_rng(7)
    shape = {
        "alternating": np.where(np.arange(STEPS) % 2, 1.0, 0.2),
        "random": random.uniform(0.0, 1.0, STEPS),
        "growing": np.linspace(0.0, 1.0, STEPS) ** 2 * np.where(np.arange(STEPS) % 3, 1.0, 0.0),
    }[kind]
    forces = 0.02 * shape[:, None, None] * random.normal(size=(1, 2, 3))
    energy, work = press(body, forces)
    assert energy.max() > 1e-9
    assert np.all(energy <= work + body.owed_j + 1e-9 * energy.max())


def test_a_steady_force_is_not_touched(duct):  # noqa: F811
    """A wall that stands still under a load swings in its rates only: nothing is taken out of them."""
    omega, steady = duct.basis.omega_rad_s, np.array([[0.0, 0.0, -0.01], [0.004, 0.0, 0.0]])
    body = DuctBody(duct, Newmark(omega, duct.damping_ratio), capacity=4)
    press(body, [steady])
    load, state = body.contact_impulse, body.state
    state.q[:], state.qdot[:] = load / omega**2, -0.5 * DT_S * load
    state.qddot[:] = -load - 2.0 * omega * duct.damping_ratio * state.qdot
    expected = state.q.copy()
    press(body, np.broadcast_to(steady, (50, 2, 3)))
    assert np.abs(state.q - expected).max() < 1e-9 * np.abs(expected).max()
    assert np.abs(body.taken).max() < 1e-9 * np.abs(state.qdot).max()
