"""How much of the insertion depends on when its ticks and samples came: nothing, and little."""

import numpy as np
import pytest

from services.mechanics import scenarios
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation
from services.mechanics.simulation.scene_duct import build_scene_duct
from services.runtime.loop import LoopMeter, TickClock

TICKS = 2100  # the hand has come to rest 200 ms before
# Half of what a particle may be deep in the wall. Friction decides within a tick where the steadying jaws stick, which
# moves the wall between them by up to 20 um; the catheter ends within 20 um too.
TOLERANCE_M = 50e-6
TOLERANCE_N = 1e-3
ON_TIME = np.arange(TICKS)


def run(duct, indices, early_s=None):
    """Step as physics does: on each index that arrives, as many steps as the clock asks for, with that frame's tools.

    Returns the simulation and the number of steps. Frame k holds the hands as they were ``early_s[k]`` before k ms.
    """
    scenario = scenarios.insertion()
    early_s = np.zeros(TICKS) if early_s is None else early_s
    simulation, tools, clock = Simulation(scenario.scene, duct), ToolInputs(), TickClock(LoopMeter(1000.0))
    taken = 0
    for index in indices:
        steps = clock.steps(int(index))
        scenario.write_inputs(1e-3 * index - early_s[index], tools)
        for _ in range(steps):
            simulation.step(tools)
        taken += steps
    return simulation, taken


def state(simulation):
    rod = simulation.catheter.state
    parts = (simulation.duct.state.q, simulation.duct.state.qdot, rod.position_m.ravel(), rod.velocity_m_s.ravel())
    return np.concatenate((*parts, simulation.tool_results.force_n.ravel(), simulation.load_force_n.ravel()))


def bursts(seed):
    """Indices as a slow reader of newest frames sees them: some twice, one to three at once, the last in any case."""
    random = np.random.default_rng(seed)
    seen = np.cumsum(random.choice([0, 1, 2, 3], TICKS, p=[0.1, 0.7, 0.15, 0.05]))
    return np.append(seen[seen < TICKS - 1], TICKS - 1)


@pytest.fixture(scope="module")
def duct(cache_dir):
    return build_scene_duct(scenarios.insertion_scene(), cache_dir)


@pytest.fixture(scope="module")
def on_time(duct):
    return run(duct, ON_TIME)[0]


def difference(simulation, reference):
    """Largest distance of a particle [m], of a modal coordinate as the wall's displacement [m], and of a force [N]."""
    moved = simulation.catheter.state.position_m - reference.catheter.state.position_m
    Phi = reference.duct.reduced.basis.Phi
    wall = Phi @ (simulation.duct.state.q - reference.duct.state.q)
    force = simulation.tool_results.force_n - reference.tool_results.force_n
    return np.abs(moved).max(), np.abs(wall).max(), np.abs(force).max()


def test_the_same_frames_give_the_same_insertion_bit_for_bit_in_whatever_bursts_they_are_answered(duct):
    indices = bursts(1)
    first, taken = run(duct, indices)
    assert taken == TICKS - indices[0]
    assert len(np.unique(np.diff(indices))) == 4
    repeated = np.repeat(indices, np.random.default_rng(2).integers(1, 4, len(indices)))
    second, again = run(duct, repeated)
    assert again == taken
    assert np.array_equal(state(first), state(second))
    assert first.inserted_length_m > 20e-3


def assert_within_tolerance(simulation, reference):
    rod_m, wall_m, force_n = difference(simulation, reference)
    assert 0.0 < rod_m < TOLERANCE_M
    assert 0.0 < wall_m < TOLERANCE_M
    assert force_n < TOLERANCE_N


def test_frames_that_were_missed_and_caught_up_change_the_end_by_little(duct, on_time):
    """One step in six has the tools of a frame up to 2 ms later."""
    assert_within_tolerance(run(duct, bursts(3))[0], on_time)


def test_samples_taken_200_us_early_or_late_change_the_end_by_little(duct, on_time):
    early_s = np.random.default_rng(4).uniform(-0.2e-3, 0.2e-3, TICKS)
    assert_within_tolerance(run(duct, ON_TIME, early_s)[0], on_time)
