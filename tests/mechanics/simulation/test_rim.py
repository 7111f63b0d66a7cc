"""A catheter whose tip is in the mouth of the duct is pulled sideways over the rim: it must not sink into the wall."""

import numpy as np
import pytest
from test_introducer import PEAK, PICK, hands, run

from tests.by_day import by_day
from trocar.services.mechanics import scenarios
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation

START = np.array([66.0, 0.0, 0.0])  # of the hand, with the tip just within the mouth; mm


def sweep(end, speed_m_s, deeper_mm):
    """From the mouth to this place of the hand, with this peak speed."""
    start = START - [deeper_mm, 0.0, 0.0]
    way_s = PEAK * 1e-3 * np.linalg.norm(end - start) / speed_m_s
    return hands((*PICK[:-1], (1.0, tuple(start)), (1.0 + way_s, tuple(end))), "sweep")


def assert_stays_out_of_the_wall(course):
    assert max(course.penetration_m) < 0.1e-3
    assert np.linalg.norm(np.diff(course.force_n, axis=0), axis=2).max() < 0.3


ENDS = ((60, -30, 30), (60, 30, 30), (60, 0, 35), (58, -20, 0), (60, -30, -30), (75, 30, -30))
SWEEPS = {(end, speed_m_s) for end in ENDS for speed_m_s in (0.1, 0.3, 0.5)}
SWEEPS_BY_DAY = [((60, -30, 30), 0.5), ((75, 30, -30), 0.3)]


@pytest.mark.parametrize(("end", "speed_m_s"), by_day(SWEEPS_BY_DAY, sorted(SWEEPS - {*SWEEPS_BY_DAY})))
def test_a_catheter_pulled_sideways_out_of_the_mouth_rests_on_its_rim(insertion_duct, end, speed_m_s):
    assert_stays_out_of_the_wall(run(sweep(np.array(end), speed_m_s, 0.0), insertion_duct))


@pytest.mark.parametrize(
    ("end", "deeper_mm"),
    by_day(
        [((60, 25, -30), 6.0)],
        [
            *(((60, -30, 30), deeper_mm) for deeper_mm in (-1.0, 1.5, 3.0, 6.0)),
            *(((60, 25, -30), deeper_mm) for deeper_mm in (-1.0, 1.5, 3.0)),
        ],
    ),
)
def test_however_deep_its_tip_is(insertion_duct, end, deeper_mm):
    assert_stays_out_of_the_wall(run(sweep(np.array(end), 0.3, deeper_mm), insertion_duct))


def overlap_with_lost_ticks_m(duct, seed):
    """Of an insertion 2 % of the ticks last up to 250 ms, in which nothing was computed and the hand went on."""
    rng, scenario = np.random.default_rng(seed), scenarios.insertion()
    simulation, tools = Simulation(scenario.scene, duct), ToolInputs()
    time_s, overlap_m = 0.0, []
    scenario.write_inputs(time_s, tools)
    simulation.step(tools)
    while time_s < scenario.duration_s + 0.6:
        is_late = rng.uniform() < 0.02
        time_s += rng.choice([2e-3, 5e-3, 20e-3, 60e-3, 250e-3], p=[0.4, 0.25, 0.2, 0.1, 0.05]) if is_late else 1e-3
        scenario.write_inputs(time_s, tools)
        simulation.step(tools)
        overlap_m.append(simulation.max_penetration_m)
    return np.array(overlap_m)


@pytest.mark.parametrize("seed", by_day([1], range(2, 13)))
def test_a_hand_that_jumps_because_ticks_were_lost_pushes_it_in_for_a_few_ticks_at_most(insertion_duct, seed):
    """With one flank of each fold alone, half of these stayed in the wall, the deepest by 1.7 mm."""
    overlap_m = overlap_with_lost_ticks_m(insertion_duct, seed)
    is_in = np.concatenate([[0], overlap_m > 0.1e-3, [0]]).astype(int)
    entered, left = np.flatnonzero(np.diff(is_in) > 0), np.flatnonzero(np.diff(is_in) < 0)
    assert max(left - entered, default=0) <= 5
    assert overlap_m.max() < 1e-3
    assert overlap_m[-1] < 10e-6
