"""What becomes of a solved step, by how far the catheter moved in it and how far contact detection looked."""

import numpy as np
import pytest

from services.mechanics.collision.candidate_list import LOOK_AHEAD_M, MAX_LOOK_AHEAD_M
from services.mechanics.scene.tools import ToolInputs
from services.mechanics.simulation import Simulation
from services.mechanics.simulation.step_splitting import Verdict

BIT_M = 1e-6


@pytest.mark.parametrize(
    ("moved_m", "reach_m", "verdict"),
    [
        (LOOK_AHEAD_M - BIT_M, LOOK_AHEAD_M, Verdict.ACCEPT),
        (LOOK_AHEAD_M + BIT_M, LOOK_AHEAD_M, Verdict.LOOK_FURTHER),
        (LOOK_AHEAD_M + BIT_M, MAX_LOOK_AHEAD_M, Verdict.ACCEPT),
        (MAX_LOOK_AHEAD_M - BIT_M, LOOK_AHEAD_M, Verdict.LOOK_FURTHER),
        (MAX_LOOK_AHEAD_M + BIT_M, LOOK_AHEAD_M, Verdict.HALVE),
        (MAX_LOOK_AHEAD_M + BIT_M, MAX_LOOK_AHEAD_M, Verdict.HALVE),
    ],
)
def test_a_step_is_judged_by_the_catheters_motion(small_scene, small_duct, moved_m, reach_m, verdict):
    simulation = Simulation(small_scene, small_duct)
    catheter = simulation.catheter
    catheter.start_m[:] = catheter.state.position_m
    catheter.state.position_m[-1, 0] += moved_m
    assert simulation.splitter.judge(reach_m) is verdict


def test_a_step_in_which_the_wall_moved_too_far_is_halved(small_scene, small_duct):
    simulation = Simulation(small_scene, small_duct)
    simulation.catheter.start_m[:] = simulation.catheter.state.position_m
    simulation.duct.q_start[:] = simulation.duct.state.q
    assert simulation.splitter.judge(LOOK_AHEAD_M) is Verdict.ACCEPT
    simulation.duct.state.q[0] += 1.0
    assert simulation.splitter.judge(LOOK_AHEAD_M) is Verdict.HALVE


def test_contacts_without_a_solution_cost_a_bounded_number_of_tries(small_scene, small_duct, monkeypatch):
    """Two ticks: a wall crushed by a shaft once took 63 tries of a millisecond each, and an episode five minutes."""
    simulation, tried_s = Simulation(small_scene, small_duct), []
    monkeypatch.setattr(simulation.solver, "solve", lambda dt_s: bool(tried_s.append(dt_s)))
    for _ in range(2):
        tried_s.clear()
        simulation.step(ToolInputs())
        assert 1e3 * np.array(tried_s) == pytest.approx([0.5**k for k in (*range(6), *range(5, 0, -1))])
