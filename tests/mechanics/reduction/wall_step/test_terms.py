"""Every term of the wall is the gradient of its energy, and their common step gives out nothing that was not put in.

Walls of random numbers, so that nothing rests on what a shell's are.
"""

from itertools import pairwise

import numpy as np
import pytest

from trocar.services.mechanics.reduction import ExactOscillator, ModalState, Newmark
from trocar.services.mechanics.reduction.hyperelastic.energy_sampling import StretchSamples
from trocar.services.mechanics.reduction.membrane_laws import MEMBRANE_LAWS
from trocar.services.mechanics.reduction.membrane_laws.beyond_linear import BeyondLinear
from trocar.services.mechanics.reduction.nonlinear.cubic_force import CubicForce
from trocar.services.mechanics.reduction.viscoelastic import NEVER, PronySeries, ViscousModes
from trocar.services.mechanics.reduction.wall_step import polynomial_membrane, sampled_membrane
from trocar.services.mechanics.reduction.wall_step.implicit_step import WallStep, held_force, relax_wall, wall_energy

MODES, SAMPLES, COORDINATES = 8, 12, 5
OMEGA = np.geomspace(60.0, 3000.0, MODES)
SERIES = PronySeries((0.2, 0.15), (0.02, 0.4))


def random_samples(random, law):
    """Triangles as stiff as the modes, of strains that the law is made for where a mode moves by 1 / omega."""
    strain = random.standard_normal((3 * SAMPLES, MODES)) * OMEGA / np.sqrt(3 * SAMPLES)
    size = np.sqrt(10.0 * law.unit_form)
    return StretchSamples(size * strain, np.full(SAMPLES, 1.0 / (SAMPLES * size**2)), law)


def random_polynomial(random):
    """Cubic and quartic energy, whose sum with that of the modes is a complete square."""
    pairs = COORDINATES * (COORDINATES + 1) // 2
    half = random.standard_normal((COORDINATES, pairs))
    scale = np.outer(OMEGA[:COORDINATES], OMEGA[:COORDINATES])[np.triu_indices(COORDINATES)]
    third = 0.7 * OMEGA[:COORDINATES, None] * half * scale
    return CubicForce.from_energies(
        np.arange(COORDINATES, dtype=np.int32), third, 0.5 * (half * scale).T @ (half * scale)
    )


def random_wall(seed, law="fung", series=NEVER, terms=("sampled", "polynomial")):
    random = np.random.default_rng(seed)
    samples = random_samples(random, BeyondLinear.of(law)) if "sampled" in terms else None
    polynomial = random_polynomial(random) if "polynomial" in terms else None
    return WallStep.of(MODES, samples, polynomial, series)


class Sampled:
    """A sampled membrane as energy, force and tangent."""

    def __init__(self, law, series=SERIES):
        self.term = random_wall(1, law, series, ("sampled",)).membrane
        self.term.behind[:] = 0.1 * np.random.default_rng(2).standard_normal(self.term.behind.shape)
        self.term.behind *= np.sqrt(BeyondLinear.of(law).unit_form)

    def energy(self, q):
        return sampled_membrane.membrane_energy(self.term, q)

    def force(self, q):
        out = np.zeros(MODES)
        sampled_membrane.membrane_force(self.term.address, q, out)
        return out

    def tangent_times(self, q, v):
        out = np.zeros(MODES)
        sampled_membrane.membrane_tangent_times(self.term.address, q, v, out)
        return out


class Polynomial:
    """A polynomial membrane as energy, force and tangent."""

    def __init__(self, series=SERIES):
        self.term = random_wall(1, series=series, terms=("polynomial",)).polynomial
        self.term.behind[:] = np.random.default_rng(2).standard_normal(self.term.behind.shape) / OMEGA[:COORDINATES]

    def energy(self, q):
        return polynomial_membrane.polynomial_energy(self.term, q)

    def force(self, q):
        out = np.zeros(MODES)
        polynomial_membrane.polynomial_force(self.term.address, q, out)
        return out

    def tangent_times(self, q, v):
        out = np.zeros(MODES)
        polynomial_membrane.polynomial_tangent_times(self.term.address, q, v, out)
        return out


TERMS = {f"sampled, {law}": (Sampled, (law,)) for law in MEMBRANE_LAWS} | {"polynomial": (Polynomial, ())}


@pytest.fixture(params=TERMS)
def term(request):
    kind, arguments = TERMS[request.param]
    return kind(*arguments)


def random_states(n, seed=4):
    return 0.3 * np.random.default_rng(seed).standard_normal((n, MODES)) / OMEGA


def test_the_force_is_the_difference_of_the_energy_and_the_tangent_that_of_the_force(term):
    for q, v in zip(random_states(30), random_states(30, seed=5), strict=True):
        v *= 1e-4 * np.linalg.norm(q * OMEGA) / np.linalg.norm(v * OMEGA)
        fell = term.energy(q - v) - term.energy(q + v)
        assert fell == pytest.approx(2.0 * term.force(q) @ v, rel=2e-3, abs=1e-4 * np.linalg.norm(term.force(q) * v))
        stiff = -0.5 * (term.force(q + v) - term.force(q - v))
        expected = term.tangent_times(q, v)
        assert stiff / OMEGA == pytest.approx(expected / OMEGA, abs=2e-3 * np.linalg.norm(expected / OMEGA))


def test_the_tangent_is_symmetric(term):
    one, other = random_states(2, seed=6)
    for q in random_states(10):
        assert one @ term.tangent_times(q, other) == pytest.approx(
            other @ term.tangent_times(q, one), rel=1e-6, abs=1e-12
        )


def test_no_closed_path_yields_work(term):
    corners = np.concatenate([np.zeros((1, MODES)), random_states(6, seed=7), np.zeros((1, MODES))])
    work = paid = 0.0
    for one, other in pairwise(corners):
        way = np.linspace(one, other, 200)
        force = np.array([term.force(q) for q in 0.5 * (way[1:] + way[:-1])])
        steps = np.sum(force * np.diff(way, axis=0), axis=1)
        work, paid = work + steps.sum(), paid + np.abs(steps).sum()
    assert abs(work) < 1e-3 * paid


class Swinging:
    """Modes without damping, and the terms."""

    def __init__(self, wall, kind, dt_s, series=NEVER):
        self.wall, self.integrator, self.dt_s = wall, kind(OMEGA, np.zeros(MODES)), dt_s
        self.state, self.held, self.viscous = ModalState.at_rest(MODES), np.zeros(MODES), ViscousModes(OMEGA, series)
        self.relaxed = np.zeros(MODES)
        unit = ModalState(np.zeros(MODES), np.zeros(MODES), np.ones(MODES))
        self.integrator.predict(unit, np.ones(MODES), dt_s)
        wall.take_gain(unit.q)
        self.decay = np.exp(-dt_s / np.array(series.tau_s, np.float64))
        self.lost_j = 0.0

    def step(self):
        state, force = self.state, np.zeros(MODES)
        relaxed = self.viscous.force()
        state.qddot += relaxed - self.relaxed
        self.relaxed = relaxed
        ahead = state.copy()
        ahead.qddot -= self.held
        self.integrator.predict(ahead, relaxed, self.dt_s)
        held_force(self.wall.address, state.q, ahead.q, force)
        state.qddot += force - self.held
        self.held = force
        self.integrator.predict(state, relaxed + force, self.dt_s)
        self.lost_j += relax_wall(self.wall.address, state.q, self.decay)
        self.viscous.relax(state.q, self.dt_s)

    def energy_j(self):
        stored = self.viscous.stored_energy_j(self.state.q) + wall_energy(self.wall.address, self.state.q)
        return self.state.kinetic_energy_j() + stored


@pytest.mark.parametrize("kind", [Newmark, ExactOscillator])
@pytest.mark.parametrize("dt_s", [1e-4, 1e-3])
@pytest.mark.parametrize("terms", [("sampled",), ("polynomial",), ("sampled", "polynomial")], ids="+".join)
@pytest.mark.parametrize("law", ["fung", "neo_hookean"])
def test_a_swinging_wall_keeps_its_energy(kind, dt_s, terms, law):
    swinging = Swinging(random_wall(3, law, terms=terms), kind, dt_s)
    swinging.state.q[:] = 0.7 * random_states(1, seed=8)[0]
    swinging.state.qddot[:] = -(OMEGA**2) * swinging.state.q
    began, energies, largest = swinging.energy_j(), [], 0.0
    for _ in range(600):
        swinging.step()
        energies.append(swinging.energy_j())
        largest = max(largest, abs(wall_energy(swinging.wall.address, swinging.state.q)))
    assert largest > 0.002 * began
    np.testing.assert_allclose(energies, began, rtol=0.01)


@pytest.mark.parametrize("kind", [Newmark, ExactOscillator])
@pytest.mark.parametrize("law", MEMBRANE_LAWS)
def test_a_wall_that_relaxes_loses_what_it_says_and_never_gains(kind, law):
    """With its linear part, which a term may take back some of: rubber gives way as it is pulled."""
    swinging = Swinging(random_wall(3, law, SERIES), kind, 1e-3, SERIES)
    swinging.state.q[:] = random_states(1, seed=8)[0]
    swinging.state.qddot[:] = -(OMEGA**2) * swinging.state.q
    began, lost = swinging.energy_j(), 0.0
    for _ in range(400):
        swinging.step()
        assert swinging.lost_j + swinging.viscous.dissipated_j >= lost - 1e-12 * began
        lost = swinging.lost_j + swinging.viscous.dissipated_j
        assert swinging.energy_j() + lost == pytest.approx(began, rel=0.01)
    assert abs(swinging.lost_j) > 1e-5 * began


def test_a_wall_that_is_put_elsewhere_does_not_take_that_for_a_gain():
    wall = random_wall(3)
    swinging = Swinging(wall, Newmark, 1e-3)
    swinging.step()
    q = random_states(1, seed=8)[0]
    held_force(wall.address, q, q, np.zeros(MODES))
    assert wall.books[0] == pytest.approx(wall_energy(wall.address, q))
