"""What finds no room is counted, wherever it is, and does no harm to what did."""

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation


@pytest.fixture
def simulate(with_effects, small_duct):
    """Tool 0 presses the duct from above, the catheter lies on the wall, tool 1 holds as many points as asked."""

    def run(capacity, n_holds=0, ticks=30, **effects):
        scene = with_effects(gravity={}, **effects)
        scene = replace(scene, contact=replace(scene.contact, capacity=capacity))
        simulation, tools = Simulation(scene, small_duct), ToolInputs()
        tools.position_m[1] = simulation.catheter.state.position_m[10] + np.array([0.0, 0.0, 8e-3])
        tools.holds = [GraspHold(number, 1, 1, 10, np.array([1.0, 0.0, 0.0]), 0.7, 0.3) for number in range(n_holds)]
        tools.jaw_angle_rad[1] = 0.31  # as good as open: nothing that they hold stops them
        for tick in range(ticks):
            tools.position_m[0] = 20e-3, 0.0, 15e-3 + 5.6e-3 - min(tick, 60) * 8e-5
            simulation.step(tools)
        return simulation

    return run


def test_with_room_for_all_nothing_is_dropped(simulate):
    simulation = simulate(96, n_holds=2, ticks=60, friction={}, mucus_drag={})
    assert simulation.contacts.n_contacts > 4
    assert simulation.dropped_contacts == (0, 0, 0)


def test_pairs_that_detection_has_no_room_for_are_counted(simulate):
    simulation = simulate(2)
    assert simulation.dropped_contacts.pairs > 0
    assert simulation.contacts.n_contacts == 2


def test_a_hold_has_its_row_where_pairs_would_take_all_the_room(simulate):
    """Before, it was stretched unfelt while pairs had all rows, and gave out what nobody had put in."""
    roomy = simulate(96, n_holds=2).contacts.n_contacts
    simulation = simulate(roomy - 1, n_holds=2)
    assert simulation.contacts.n_contacts == roomy - 1
    assert len(simulation.holds.rows) == 2
    assert sum(simulation.dropped_contacts) > 0


def test_rows_of_effects_beyond_the_capacity_are_counted(simulate):
    roomy = simulate(96).contacts.n_contacts
    simulation = simulate(roomy, mucus_drag={})
    assert simulation.contacts.n_contacts == roomy
    assert simulation.dropped_contacts.rows > 0


def test_a_step_that_does_not_settle_for_want_of_rows_loses_no_contact(simulate):
    """What ended too deep was accepted, and counted as dropped; now what is sound of the motion is kept: here all."""
    simulation, tools = simulate(4), ToolInputs()
    assert simulation.contacts.n_contacts == 4
    solve, before_s = simulation.solver.solve, simulation.withheld_s
    simulation.solver.solve = lambda dt_s: solve(dt_s) and False
    tools.position_m[:], tools.jaw_angle_rad[:] = simulation.tools.hand[:, :3], simulation.tools.hand[:, 3]
    simulation.step(tools)
    assert simulation.dropped_contacts.rows == 0
    assert simulation.withheld_s == before_s


def test_holds_beyond_those_that_are_followed_are_counted(simulate):
    simulation = simulate(96, n_holds=20, ticks=3)
    assert len(simulation.holds.active) == 16
    assert simulation.dropped_contacts.holds == 3 * 4


def test_limits_of_grasps_go_to_the_rows_of_grasps_where_rows_run_out(simulate):
    # Three ticks: before what has been left out has moved anything, so that both touch the same.
    effects = {"friction": {}, "grasp_slip": {}}
    roomy = simulate(96, n_holds=4, ticks=3, **effects)
    assert len(roomy.holds.rows) == 4
    simulation = simulate(roomy.contacts.n_contacts - 1, n_holds=4, ticks=3, **effects)
    rows, holds = simulation.contacts, list(simulation.holds.rows)
    others = [row for row in range(rows.n_contacts) if row not in holds]
    assert len(holds) == 4
    assert np.all(rows.force_limit_n[holds] == 0.7)
    assert set(rows.force_limit_n[others]) <= {0.0, np.inf}
    assert rows.friction[others].max() <= 0.3
    assert sum(simulation.dropped_contacts) >= 1
