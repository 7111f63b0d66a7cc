"""Whatever presses a wall that softens, and however it moves: what it gives out it was given before.

Walls of random numbers, so that nothing rests on what a shell's are.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from tests.by_day import by_day
from trocar.services.mechanics.reduction import ExactOscillator, ModalState, Newmark
from trocar.services.mechanics.reduction.softened_wall.load_pattern import TURN, Pattern
from trocar.services.mechanics.reduction.softened_wall.softened_wall import SPENT, STORED, TANK, SoftenedWall
from trocar.services.mechanics.reduction.softened_wall.softening_force import CREDIT_J, follow_loads, push_ahead
from trocar.services.mechanics.reduction.softening.softening_law import parts
from trocar.services.mechanics.reduction.viscoelastic import NEVER, PronySeries, ViscousModes

SITES, MODES, NODES = 9, 14, 30
RHO = np.linspace(-0.4, 1.2, 129)
STEP = RHO[1] - RHO[0]
RHO = RHO - RHO[np.abs(RHO).argmin()]


def random_wall(random, integrator, coefficients, strength=1.0, series=NEVER, n_laws=1):
    """A wall whose sites and modes have to do with each other, as those of a shell, and whose numbers are small."""
    shapes = random.normal(size=(MODES, SITES)) / np.sqrt(MODES)
    third = random.normal(size=(SITES, SITES, SITES))
    third = sum(third.transpose(p) for p in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)))
    stiffness = OMEGA**2
    local = shapes.T @ (shapes / stiffness[:, None])
    patterns = {
        name: Pattern.zeros(r=MODES, p=len(RHO), rho_first=RHO[0], rho_step=STEP) for name in ("pattern", "candidate")
    }
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
        "rest_q": 1e-3 * random.normal(size=MODES),
    }
    if n_laws == 2:
        arrays |= nodes_of(random, arrays, 0.02 * strength * np.abs(local).max() ** 1.5)
    plain = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    plain |= {"g": np.array(series.g, np.float64), "tau_s": np.array(series.tau_s, np.float64)}
    extents = {"l": n_laws, "m": SITES, "r": MODES, "p": len(RHO), "t": len(series.g)}
    extents |= {"h": NODES, "z": 7} if n_laws == 2 else {"h": 0, "z": 0, "a": 0, "b": 0}
    plain |= {"takes_mean": isinstance(integrator, Newmark), "most_softening": 0.9, "n_local": 2}
    return SoftenedWall.zeros(**extents, **patterns, **plain)


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
    """A wall under random loads and blows, its energy, and the least of what it has spent less what it had spent."""

    fell_j: float = 0.0
    imbalance_j: float = 0.0
    largest_j: float = 0.0
    owed_j: float = 0.0
    softened: int = 0
    turned: int = 0


def shake(seed, kind, dt_s, ways, coefficients, series=NEVER, ticks=1500):
    """A wall of one law, and of two where the seed is odd."""
    random = np.random.default_rng(seed)
    integrator = kind(OMEGA, np.zeros(MODES))
    strength = 10.0 if coefficients is TURNING else 1.0
    wall = random_wall(random, integrator, np.array(coefficients), strength, series, 1 + seed % 2)
    if series.g:
        wall.rest_q[:] = 0.0
    state, seen, viscous = ModalState.at_rest(MODES), Shaken(), ViscousModes(OMEGA, series)
    state.q[:] = wall.rest_q
    constant = OMEGA**2 * wall.rest_q
    nodes, forces = np.zeros(0, np.int32), np.zeros((0, 3))

    def energy():
        rest = state.q - wall.rest_q
        return state.kinetic_energy_j() + viscous.stored_energy_j(rest) + wall.books[STORED]

    def drive():
        force = constant + wall.force
        viscous.add_force(force)
        return force

    def relax():
        """Newmark's step is exact for a force that is held if it began with it, see `ViscousModes`."""
        before, after = np.zeros((2, MODES))
        viscous.add_force(before)
        viscous.relax(state.q, dt_s)
        viscous.add_force(after)
        if kind is Newmark:
            state.qddot += after - before

    def spent_j():
        return wall.books[SPENT] + viscous.dissipated_j

    for tick in range(ticks):
        if tick % random.integers(1, 40) == 0:
            nodes = random.choice(NODES, random.integers(0, 5), replace=False).astype(np.int32)
            forces = (
                random.choice(ways, len(nodes))[:, None]
                * np.abs(random.normal(size=(len(nodes), 3)))
                * 10.0 ** random.uniform(-2, 0)
            )
        if wall.stiffens():
            ahead = state.copy()
            integrator.predict(ahead, drive(), dt_s)
            push_ahead(wall.address, state.q, ahead.q, integrator.gains(dt_s).position, state.qddot)
        if tick % 50 == 0:  # unforeseen, as contacts that change are
            state.qdot += 0.03 * random.normal(size=MODES)
        before, spent, q_start = energy(), spent_j(), state.q.copy()
        integrator.predict(state, drive(), dt_s)
        modal = 0.01 * random.normal(size=MODES) + OMEGA**2 * (state.q - wall.rest_q)
        made = integrator.gains(dt_s)
        gains = made.position, made.velocity, made.acceleration
        follow_loads(wall.address, (nodes, forces), modal, (state.q, q_start, state.qdot, state.qddot), gains, dt_s)
        relax()
        change, after = spent_j() - spent, energy()
        seen.largest_j = max(seen.largest_j, after)
        seen.fell_j = max(seen.fell_j, -change)
        seen.imbalance_j = max(seen.imbalance_j, abs(after + change - before))
        seen.softened += bool(wall.force.any())
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
    for seed in range(3):
        seen = shake(seed, kind, dt_s, ways, coefficients)
        assert seen.softened > (0 if ways is OUTWARD or coefficients is TURNING else 50)
        assert seen.fell_j == 0.0
        assert seen.imbalance_j <= 1e-9 * seen.largest_j
        assert seen.owed_j <= 2.0 * CREDIT_J + (
            0.0 if ways is INWARD and coefficients is not TURNING else 1e-5 * seen.largest_j
        )
        assert coefficients is not TURNING or seen.turned > 50


RELAXING = PronySeries((0.3, 0.3), (4e-3, 0.1))


@pytest.mark.parametrize(
    ("kind", "dt_s", "ways", "coefficients"),
    by_day(*([each for each in CASES if (each[1:3] == (1e-3, BOTH)) is day] for day in (True, False))),
)
def test_what_relaxes_gives_out_nothing_either(kind, dt_s, ways, coefficients):
    """What softening takes back of what the linear wall dissipates is never more than that."""
    for seed in range(2):
        seen = shake(seed, kind, dt_s, ways, coefficients, RELAXING)
        print(seen)
        assert seen.softened > (0 if ways is OUTWARD or coefficients is TURNING else 50)
        assert seen.fell_j <= 1e-12 * seen.largest_j
        assert seen.imbalance_j <= 1e-9 * seen.largest_j
        assert seen.owed_j <= 2.0 * CREDIT_J + (
            0.0 if ways is INWARD and coefficients is not TURNING else 1e-5 * seen.largest_j
        )


def test_a_pattern_has_the_mean_law_of_the_nodes_that_are_pressed():
    """By the forces on them, whatever sites these are spread over: beside a support it changes from node to node."""
    random, integrator = np.random.default_rng(5), Newmark(OMEGA, np.zeros(MODES))
    wall, state = random_wall(random, integrator, np.array(GIVING)), ModalState.at_rest(MODES)
    wall.coefficients[:] *= random.uniform(0.5, 2.0, (1, NODES, 1))
    wall.near[7], wall.weights[7] = wall.near[3], wall.weights[3]
    gains = integrator.gains(1e-3)
    nodes, forces = np.array([3, 7], np.int32), np.array([[0.3, 0.0, 0.4], [0.0, 0.1, 0.0]])
    for _ in range(3):
        motion = state.q, state.q.copy(), state.qdot, state.qddot
        made = gains.position, gains.velocity, gains.acceleration
        follow_loads(wall.address, (nodes, forces), np.ones(MODES), motion, made, 1e-3)
    mixed = wall.pressed_mixed[0, :-1] / wall.pressed_mixed[0, -1]
    np.testing.assert_allclose(mixed, (5.0 * wall.coefficients[0, 3] + wall.coefficients[0, 7]) / 6.0, rtol=1e-12)
