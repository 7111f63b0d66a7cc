"""Whatever presses a wall that softens, and however it moves: what it gives out it was given before.

Walls of random numbers, so that nothing rests on what a shell's are.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from tests.by_day import by_day
from trocar.services.mechanics.reduction import ExactOscillator, ModalState, Newmark
from trocar.services.mechanics.reduction.softened_wall.load_pattern import TURN, Pattern
from trocar.services.mechanics.reduction.softened_wall.pattern_change import change_pattern
from trocar.services.mechanics.reduction.softened_wall.softened_wall import SoftenedWall
from trocar.services.mechanics.reduction.softening.softening_law import parts
from trocar.services.mechanics.reduction.viscoelastic import NEVER, PronySeries, ViscousModes
from trocar.services.mechanics.reduction.wall_step.energy_tank import settle_step
from trocar.services.mechanics.reduction.wall_step.implicit_step import (
    CREDIT_J,
    TANK,
    WallStep,
    held_force,
    relax_wall,
    wall_energy,
)
from trocar.services.mechanics.reduction.wall_step.lagging_energy import conjugate_energy

SITES, MODES, NODES = 9, 14, 30
RHO = np.linspace(-0.4, 1.2, 129)
STEP = RHO[1] - RHO[0]
RHO = RHO - RHO[np.abs(RHO).argmin()]


def random_wall(random, coefficients, strength=1.0, n_laws=1):
    """A wall whose sites and modes have to do with each other, as those of a shell, and whose numbers are small."""
    shapes = random.normal(size=(MODES, SITES)) / np.sqrt(MODES)
    third = random.normal(size=(SITES, SITES, SITES))
    third = sum(third.transpose(p) for p in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)))
    stiffness = OMEGA**2
    local = shapes.T @ (shapes / stiffness[:, None])
    candidate = Pattern.zeros(r=MODES, p=len(RHO), rho_first=RHO[0], rho_step=STEP)
    arrays = {
        "near": random.integers(0, SITES, (NODES, 6)).astype(np.int32),
        "weights": np.abs(random.normal(size=(NODES, 6, 3))),
        "local": local,
        "third": (-0.02 * strength * np.abs(third) * np.abs(local).max() ** 1.5).astype(np.float32),
        "coefficients": np.tile(coefficients, (n_laws, NODES, 1)),
        "parts": np.stack([parts(RHO), parts(np.clip(RHO, -0.2, 0.9))][:n_laws]),
        "blunt": np.stack([np.ones(NODES), np.linspace(0.7, 1.4, NODES)][:n_laws]),
        "counts": np.stack([np.ones(NODES), np.clip(np.linspace(-0.5, 1.5, NODES), 0.0, 1.0)][:n_laws]),
        "delivery": shapes / stiffness[:, None] @ np.linalg.inv(local),
        "stiffness": stiffness,
    }
    if n_laws == 2:
        arrays |= nodes_of(random, arrays, 0.02 * strength * np.abs(local).max() ** 1.5)
    plain = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    extents = {"l": n_laws, "m": SITES, "r": MODES, "p": len(RHO)}
    extents |= {"h": NODES, "z": 7} if n_laws == 2 else {"h": 0, "z": 0, "a": 0, "b": 0}
    return SoftenedWall.zeros(**extents, candidate=candidate, n_local=2, **plain)


def nodes_of(random, arrays, strength):
    """Energies of forces on the nodes themselves: like those of the sites, and the rest of random numbers."""
    spread = np.zeros((NODES, SITES))
    np.add.at(spread, (np.arange(NODES)[:, None], arrays["near"]), arrays["weights"][:, :, 0])
    sharp = random.normal(size=(NODES, 7, 7)) - 1.0
    return {
        "inward": np.tile((1.0, 0.0, 0.0), (NODES, 1)),
        "sites_nearby": random.integers(0, SITES, (NODES, 4)).astype(np.int32),
        "nodes_nearby": random.integers(0, NODES, (NODES, 3)).astype(np.int32),
        "sharp": (strength * (sharp + sharp.transpose(0, 2, 1))).astype(np.float32),
        "node_local": (1.2 * spread @ arrays["local"] @ spread.T).astype(np.float32),
    }


OMEGA = np.geomspace(100.0, 2e4, MODES)
GIVING, STIFFENING = (3.0, 0.5, 1.0, 0.5, 0.0, 0.0), (3.0, -2.0, 4.0, 0.0, 0.0, -6.0)
TURNING = (3.0, 0.0, 0.0, -60.0, -60.0, -6.0)


@dataclass
class Shaken:
    """A wall under random loads and blows: by how much its energy rose in a step, at most, beyond what was put in.

    ``missed_j`` is by how much the energy of its terms fell at most where a pattern changed, less what was told.
    """

    rose_j: float = 0.0
    largest_j: float = 0.0
    owed_j: float = 0.0
    missed_j: float = 0.0
    softened: int = 0
    turned: int = 0


class Modes:
    """Modes at the end of a step, as `settle_step` sees them."""

    def __init__(self, integrator, dt_s):
        self.state, self.q_start, self.contact_impulse = ModalState.at_rest(MODES), np.zeros(MODES), np.zeros(MODES)
        unit = ModalState(np.zeros(MODES), np.zeros(MODES), np.ones(MODES))
        integrator.predict(unit, np.ones(MODES), dt_s)
        self.gains, self.held_gain = (unit.q, unit.qdot, unit.qddot), unit.q

    def furthest_m(self, change):
        return np.abs(change).max()

    def change_held(self, held, change):
        for end, gain in zip((self.state.q, self.state.qdot, self.state.qddot), self.gains, strict=True):
            end += gain * change
        held += change

    def remove_energy(self, energy_j):
        kinetic_j = self.state.kinetic_energy_j()
        paid = min(energy_j / kinetic_j, 1.0) if kinetic_j > 0.0 else 0.0
        self.state.qdot *= np.sqrt(1.0 - paid)
        return paid * kinetic_j


def shake(seed, kind, dt_s, ways, coefficients, series=NEVER, ticks=1500):
    """A wall of one law, and of two where the seed is odd."""
    random = np.random.default_rng(seed)
    integrator = kind(OMEGA, np.zeros(MODES))
    soft = random_wall(random, np.array(coefficients), 10.0 if coefficients is TURNING else 1.0, 1 + seed % 2)
    wall = WallStep.of(OMEGA**2, series=series, pattern=soft.new_pattern())
    modes, seen, viscous = Modes(integrator, dt_s), Shaken(), ViscousModes(OMEGA, series)
    state, held, lagged, force = modes.state, *np.zeros((3, MODES))
    wall.take_gain(modes.held_gain)
    decay = np.exp(-dt_s / np.array(series.tau_s, np.float64))
    nodes, forces = np.zeros(0, np.int32), np.zeros((0, 3))

    def energy():
        total = state.kinetic_energy_j() + state.strain_energy_j(OMEGA) + wall_energy(wall.address, state.q)
        for g, d, lag in zip(viscous.g, viscous.d, wall.lag, strict=True):
            h = OMEGA**2 * d + lag
            total += g * (conjugate_energy(wall, h, state.q) - h @ state.q)
        return total

    for tick in range(ticks):
        if tick % random.integers(1, 40) == 0:
            nodes = random.choice(NODES, random.integers(0, 5), replace=False).astype(np.int32)
            forces = (
                random.choice(ways, len(nodes))[:, None]
                * np.abs(random.normal(size=(len(nodes), 3)))
                * 10.0 ** random.uniform(-2, 0)
            )
        lagging = viscous.force() + wall.lagging
        state.qddot += lagging - lagged
        lagged[:] = lagging
        ahead = state.copy()
        ahead.qddot -= held
        integrator.predict(ahead, lagging, dt_s)
        held_force(wall.address, state.q, ahead.q, force)
        state.qddot += force - held
        held[:] = force
        if tick % 50 == 0:  # unforeseen, as contacts that change are
            state.qdot += 0.03 * random.normal(size=MODES)
        before = energy() + max(wall.books[TANK], 0.0)
        modes.q_start[:] = state.q
        integrator.predict(state, lagging + held, dt_s)
        settle_step(wall, held, modes, lambda: 1.0)
        viscous.relax(state.q, dt_s)
        relax_wall(wall.address, modes.q_start, state.q, decay)
        modal = 0.01 * random.normal(size=MODES) + OMEGA**2 * state.q
        of_terms = wall_energy(wall.address, state.q)
        fell = change_pattern(soft.address, wall.address, (nodes, forces), modal, (state.q, viscous.d), dt_s)
        seen.missed_j = max(seen.missed_j, abs(of_terms - wall_energy(wall.address, state.q) - fell))
        after = energy()
        seen.rose_j = max(seen.rose_j, after - before)
        seen.largest_j = max(seen.largest_j, after)
        seen.softened += bool(held.any())
        seen.turned += 0.0 < wall.pattern.numbers[TURN] < np.inf
        seen.owed_j = max(seen.owed_j, -wall.books[TANK])
    return seen


INWARD, OUTWARD, BOTH = (1.0,), (-1.0,), (1.0, -1.0)
CASES = [
    (kind, dt_s, ways, coefficients)
    for kind in (Newmark, ExactOscillator)
    for dt_s in (1e-4, 1e-3, 5e-2)
    for ways, coefficients in (
        (INWARD, GIVING),
        (BOTH, GIVING),
        (OUTWARD, STIFFENING),
        (BOTH, STIFFENING),
        (INWARD, TURNING),
        (BOTH, TURNING),
    )
]
#: By day at the step of a tick; at a tenth and at fifty in the long run.
SHAKEN = by_day([each for each in CASES if each[1] == 1e-3], [each for each in CASES if each[1] != 1e-3])


@pytest.mark.parametrize(("kind", "dt_s", "ways", "coefficients"), SHAKEN)
def test_nothing_comes_out_that_was_not_put_in(kind, dt_s, ways, coefficients):
    """But for what the tank may owe, and for rounding: rows are in single precision."""
    for seed in range(3):
        seen = shake(seed, kind, dt_s, ways, coefficients)
        assert seen.softened > (0 if ways is OUTWARD or coefficients is TURNING else 50)
        assert seen.rose_j <= 2.0 * CREDIT_J + 1e-6 * seen.largest_j
        assert seen.owed_j <= 2.0 * CREDIT_J
        assert coefficients is not TURNING or seen.turned > 50


RELAXING = PronySeries((0.3, 0.3), (4e-3, 0.1))


@pytest.mark.parametrize(
    ("kind", "dt_s", "ways", "coefficients"),
    by_day(*([each for each in CASES if (each[1:3] == (1e-3, BOTH)) is day] for day in (True, False))),
)
def test_what_relaxes_gives_out_nothing_either(kind, dt_s, ways, coefficients):
    for seed in range(2):
        seen = shake(seed, kind, dt_s, ways, coefficients, RELAXING, ticks=500)
        assert seen.missed_j <= 1e-6 * seen.largest_j
        assert seen.softened > (0 if ways is OUTWARD or coefficients is TURNING else 50)
        assert seen.rose_j <= 2.0 * CREDIT_J + 1e-6 * seen.largest_j
        assert seen.owed_j <= 2.0 * CREDIT_J


def test_a_pattern_has_the_mean_law_of_the_nodes_that_are_pressed():
    """By the forces on them, whatever sites these are spread over: beside a support it changes from node to node."""
    random = np.random.default_rng(5)
    wall, q = random_wall(random, np.array(GIVING)), np.zeros(MODES)
    step = WallStep.of(OMEGA**2, pattern=wall.new_pattern())
    wall.coefficients[:] *= random.uniform(0.5, 2.0, (1, NODES, 1))
    wall.near[7], wall.weights[7] = wall.near[3], wall.weights[3]
    nodes, forces = np.array([3, 7], np.int32), np.array([[0.3, 0.0, 0.4], [0.0, 0.1, 0.0]])
    for _ in range(3):
        change_pattern(wall.address, step.address, (nodes, forces), np.ones(MODES), (q, q[None][:0]), 1e-3)
    mixed = wall.pressed_mixed[0, :-1] / wall.pressed_mixed[0, -1]
    np.testing.assert_allclose(mixed, (5.0 * wall.coefficients[0, 3] + wall.coefficients[0, 7]) / 6.0, rtol=1e-12)
