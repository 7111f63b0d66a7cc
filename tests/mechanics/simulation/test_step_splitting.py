"""What becomes of a solved step, by how far catheter and wall moved in it and how far contact detection looked."""

import numpy as np
import pytest

from trocar.services.mechanics.collision.candidate_list import LOOK_AHEAD_M
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.mechanics.simulation.step_solver import MOST_PRODUCTS
from trocar.services.mechanics.simulation.step_splitting import SLOW_M

BIT_M = 1e-6


def moved(scene, duct, by_m):
    simulation = Simulation(scene, duct)
    catheter = simulation.catheter
    simulation.duct.change_step(1e-3)
    catheter.start_m[:] = catheter.state.position_m
    catheter.state.position_m[-1, 0] += by_m
    simulation.duct.q_start[:] = simulation.duct.state.q
    return simulation


@pytest.mark.parametrize(("by_m", "is_detected"), [(LOOK_AHEAD_M - BIT_M, True), (LOOK_AHEAD_M + BIT_M, False)])
def test_a_step_is_judged_by_the_catheters_motion(small_scene, small_duct, by_m, is_detected):
    assert moved(small_scene, small_duct, by_m).splitter.is_detected() is is_detected


@pytest.mark.parametrize(("by_m", "is_detected"), [(SLOW_M - BIT_M, True), (SLOW_M + BIT_M, False)])
def test_a_catheter_near_itself_may_move_less(small_scene, small_duct, by_m, is_detected):
    simulation = moved(small_scene, small_duct, by_m)
    simulation.splitter._may_move_far = False
    assert simulation.splitter.is_detected() is is_detected


def test_a_step_in_which_the_wall_moved_too_far_is_halved(small_scene, small_duct):
    simulation = moved(small_scene, small_duct, 0.0)
    assert simulation.splitter.is_detected()
    simulation.duct.state.q[0] += 1.0
    assert not simulation.splitter.is_detected()


@pytest.mark.parametrize(("by_m", "parts"), [(LOOK_AHEAD_M - BIT_M, 1), (LOOK_AHEAD_M + BIT_M, 2), (8e-3, 4)])
def test_a_step_begins_in_as_many_parts_as_the_speed_of_the_last_one_calls_for(small_scene, small_duct, by_m, parts):
    splitter = moved(small_scene, small_duct, by_m).splitter
    assert splitter.parts(ToolInputs(), 1e-3) == 1
    splitter.is_detected()
    assert splitter.parts(ToolInputs(), 1e-3) == parts


@pytest.mark.parametrize(("sound_share", "tries", "withheld_s"), [(1.0, 1, 0.0), (0.0, 6, 1e-3)])
def test_contacts_without_a_solution_cost_a_bounded_number_of_tries(
    small_scene, small_duct, monkeypatch, sound_share, tries, withheld_s
):
    """Two ticks: a wall crushed by a shaft once took 63 tries of a millisecond each, and an episode five minutes.

    What ends sound is accepted though its prices are not settled; where nothing is, the tick's products are soon spent.
    """
    simulation, tried_s = Simulation(small_scene, small_duct), []

    def solve(dt_s):
        tried_s.append(dt_s)
        simulation.solver.products += 0.18 * MOST_PRODUCTS
        return False

    monkeypatch.setattr(simulation.solver, "solve", solve)
    monkeypatch.setattr(simulation._motion_share, "find", lambda *_: sound_share)
    monkeypatch.setattr(simulation._motion_share, "looks", 0)
    for tick in range(1, 3):
        tried_s.clear()
        simulation.step(ToolInputs())
        assert 1e3 * np.array(tried_s) == pytest.approx([0.5**k for k in range(tries)])
        assert simulation.withheld_s == pytest.approx(tick * withheld_s)
