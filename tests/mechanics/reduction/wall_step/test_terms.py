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
from trocar.services.mechanics.reduction.nonlinear.membrane_polynomial import MembranePolynomial
from trocar.services.mechanics.reduction.softened_wall.load_pattern import (
    DELIVERED,
    GAIN,
    LINEAR,
    PART,
    RHO,
    Pattern,
    bound_law,
    integrate_law,
)
from trocar.services.mechanics.reduction.viscoelastic import NEVER, PronySeries, ViscousModes
from trocar.services.mechanics.reduction.wall_step.implicit_step import (
    WallStep,
    held_force,
    relax_wall,
    replace_terms,
    wall_energy,
    wall_force,
    wall_tangent_times,
)
from trocar.services.mechanics.reduction.wall_step.lagging_energy import conjugate_energy

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
    return MembranePolynomial.from_energies(
        np.arange(COORDINATES, dtype=np.int32), third, 0.5 * (half * scale).T @ (half * scale)
    )


RHO_POINTS = 0.02 * np.arange(-30, 100)


def random_pattern(random, pulled=False):
    """A pattern along which the wall gives way, or stiffens, by its own size at displacements of some 1 / omega."""
    pattern = Pattern.zeros(r=MODES, p=len(RHO_POINTS), rho_first=RHO_POINTS[0], rho_step=0.02)
    t = random.standard_normal(MODES) / OMEGA / np.sqrt(MODES)
    pattern.direction[:] = OMEGA**2 * t
    delivered = float(t @ pattern.direction)
    rho = -0.5 if pulled else 0.5
    pattern.work[:] = np.where(RHO_POINTS > 0.0, 3.0 * RHO_POINTS / (1.0 + RHO_POINTS), 2.0 * RHO_POINTS)
    pattern.numbers[[LINEAR, DELIVERED, GAIN, RHO, PART]] = 0.3 * delivered, delivered, 1.0, rho, 1.0
    bound_law(pattern)
    integrate_law(pattern)
    return pattern


def random_wall(seed, law="fung", series=NEVER, terms=("sampled", "polynomial")):
    random = np.random.default_rng(seed)
    samples = random_samples(random, BeyondLinear.of(law)) if "sampled" in terms else None
    polynomial = random_polynomial(random) if "polynomial" in terms else None
    pattern = random_pattern(random, "pulled" in terms) if {"pattern", "pulled"} & set(terms) else None
    wall = WallStep.of(OMEGA**2, samples, polynomial, series, pattern)
    wall.rest[:] = 0.01 * random.standard_normal(MODES) / OMEGA
    replace_terms(wall.address, np.zeros(MODES))
    return wall


KINDS = {f"sampled, {law}": (law, ("sampled",)) for law in MEMBRANE_LAWS}
KINDS |= {
    "+".join(terms): ("fung", terms)
    for terms in (
        ("polynomial",),
        ("pattern",),
        ("pulled",),
        ("polynomial", "pattern"),
        ("sampled", "polynomial", "pattern"),
    )
}


class Terms:
    """Terms of a wall as energy, force and tangent."""

    def __init__(self, law, terms):
        self.wall = random_wall(1, law, terms=terms)

    def energy(self, q):
        return wall_energy(self.wall.address, q)

    def force(self, q):
        out = np.zeros(MODES)
        wall_force(self.wall.address, q, out)
        return out

    def tangent_times(self, q, v):
        out = np.zeros(MODES)
        wall_tangent_times(self.wall.address, q, v, out)
        return out


@pytest.fixture(params=KINDS)
def term(request):
    return Terms(*KINDS[request.param])


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


@pytest.mark.parametrize("name", KINDS)
def test_no_closed_path_of_a_wall_that_relaxes_yields_work(name):
    """Whoever moves it round, at any speed, puts work in; the second time round as well."""
    law, terms = KINDS[name]
    for ticks in (10, 100, 1000):
        wall, viscous = random_wall(3, law, SERIES, terms), ViscousModes(OMEGA, SERIES)
        corners = np.concatenate([np.zeros((1, MODES)), random_states(4, seed=7)])
        decay, work, rounds = np.exp(-1e-3 / np.array(SERIES.tau_s)), 0.0, []
        for one, other in pairwise([*corners, *corners, corners[0]]):
            way = np.linspace(one, other, ticks + 1)
            for start, end in pairwise(way):
                lasting = viscous.force() + wall.lagging
                elastic = 0.5 * float(np.sum(OMEGA**2 * (end**2 - start**2)))
                elastic += wall_energy(wall.address, end) - wall_energy(wall.address, start)
                work += elastic - float(lasting @ (end - start))
                relax_wall(wall.address, start, end, decay)
                viscous.relax(end, 1e-3)
            rounds.append(work)
        assert rounds[len(corners) - 1] > 0.0
        assert rounds[-1] > rounds[len(corners) - 1]


class Swinging:
    """Modes without damping, and the terms."""

    def __init__(self, wall, kind, dt_s, series=NEVER):
        self.wall, self.integrator, self.dt_s = wall, kind(OMEGA, np.zeros(MODES)), dt_s
        self.state, self.held, self.viscous = ModalState.at_rest(MODES), np.zeros(MODES), ViscousModes(OMEGA, series)
        self.relaxed = np.zeros(MODES)
        unit = ModalState(np.zeros(MODES), np.zeros(MODES), np.ones(MODES))
        self.integrator.predict(unit, np.ones(MODES), dt_s)
        wall.take_gain(unit.q)
        self.decay, self.q_start = np.exp(-dt_s / np.array(series.tau_s, np.float64)), np.zeros(MODES)

    def step(self):
        state, force = self.state, np.zeros(MODES)
        relaxed = self.viscous.force() + self.wall.lagging
        state.qddot += relaxed - self.relaxed
        self.relaxed = relaxed
        ahead = state.copy()
        ahead.qddot -= self.held
        self.integrator.predict(ahead, relaxed, self.dt_s)
        held_force(self.wall.address, state.q, ahead.q, force)
        state.qddot += force - self.held
        self.held = force
        self.q_start[:] = state.q
        self.integrator.predict(state, relaxed + force, self.dt_s)
        relax_wall(self.wall.address, self.q_start, state.q, self.decay)
        self.viscous.relax(state.q, self.dt_s)

    def energy_j(self):
        """Return kinetic energy, and that of the wall: linear, of the terms, and of what lags."""
        q = self.state.q
        stored = 0.5 * float(np.sum((OMEGA * q) ** 2)) + wall_energy(self.wall.address, q)
        for g, d, lag in zip(self.viscous.g, self.viscous.d, self.wall.lag, strict=True):
            h = OMEGA**2 * d + lag
            stored += g * (conjugate_energy(self.wall, h, q) - float(h @ q))
        return self.state.kinetic_energy_j() + stored


@pytest.mark.parametrize("kind", [Newmark, ExactOscillator])
@pytest.mark.parametrize("dt_s", [1e-4, 1e-3])
@pytest.mark.parametrize(
    "terms",
    [("sampled",), ("polynomial",), ("sampled", "polynomial"), ("pattern",), ("polynomial", "pattern")],
    ids="+".join,
)
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
@pytest.mark.parametrize("name", KINDS)
def test_a_wall_that_relaxes_never_gains(kind, name):
    """Left to itself it swings, and what it stores and moves with only falls; held, it would bear what lasts."""
    law, terms = KINDS[name]
    swinging = Swinging(random_wall(3, law, SERIES, terms), kind, 1e-3, SERIES)
    swinging.state.q[:] = random_states(1, seed=8)[0]
    swinging.state.qddot[:] = -(OMEGA**2) * swinging.state.q
    began = before = swinging.energy_j()
    for _ in range(400):
        swinging.step()
        now = swinging.energy_j()
        assert now <= before + 2e-3 * began
        before = min(now, before)
    assert before < 0.9 * began


@pytest.mark.parametrize("name", KINDS)
def test_a_wall_that_is_held_relaxes_by_its_series(name):
    """Whatever its laws are: all of its force, at any time."""
    law, terms = KINDS[name]
    wall, viscous = random_wall(3, law, SERIES, terms), ViscousModes(OMEGA, SERIES)
    q = random_states(1, seed=8)[0]
    elastic = OMEGA**2 * q
    wall_force(wall.address, q, borne := np.zeros(MODES))
    elastic -= borne
    for tick in range(1, 200):
        relax_wall(wall.address, q, q, np.exp(-1e-3 / np.array(SERIES.tau_s)))
        viscous.relax(q, 1e-3)
        force = OMEGA**2 * q - borne - viscous.force() - wall.lagging
        np.testing.assert_allclose(force, elastic * SERIES.relaxation(np.array([1e-3 * tick])), rtol=1e-6, atol=1e-9)


def test_a_wall_that_is_put_elsewhere_does_not_take_that_for_a_gain():
    wall = random_wall(3)
    swinging = Swinging(wall, Newmark, 1e-3)
    swinging.step()
    q = random_states(1, seed=8)[0]
    held_force(wall.address, q, q, np.zeros(MODES))
    assert wall.books[0] == pytest.approx(wall_energy(wall.address, q))
