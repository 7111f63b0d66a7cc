"""What a caller may hand in that no hand can do: tools that vanish, numbers that are none, ticks without a length."""

from dataclasses import replace

import numpy as np
import pytest

from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, DUCT_TRIANGLE
from trocar.services.mechanics.scene.tools import GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation

PRESSING_M = (20e-3, 0.0, 15e-3 + 1.5e-3)
AWAY_M = (60e-3, 0.0, 60e-3)
HOLD = GraspHold(3, 1, CATHETER_SEGMENT, 10, np.array([1.0, 0.0, 0.0]), 0.7, 0.3)


def state(simulation):
    duct, rod = simulation.duct.state, simulation.catheter.state
    return np.concatenate([duct.q, duct.qdot, rod.position_m.ravel(), rod.velocity_m_s.ravel()])


@pytest.fixture
def pressed(small_scene, small_duct):
    """Tool 0 presses the wall from above, tool 1 is away."""
    simulation, tools = Simulation(small_scene, small_duct), ToolInputs()
    for tick in range(100):
        tools.position_m[:] = np.add(PRESSING_M, (0.0, 0.0, max(6e-3 - tick * 9e-5, 0.0))), AWAY_M
        simulation.step(tools)
    assert np.linalg.norm(simulation.tool_results.force_n[0]) > 0.05
    return simulation, tools


def test_a_tool_that_vanishes_presses_no_more_and_returns_with_its_proxy_at_the_hand(pressed):
    simulation, tools = pressed
    tools.present[0] = False
    simulation.step(tools)
    assert not simulation.tool_results.force_n.any()
    assert not (simulation.contacts.tool[: simulation.contacts.n_contacts] == 0).any()
    for _ in range(20):
        simulation.step(tools)
        assert not simulation.tool_results.force_n.any()
    tools.present[0], tools.position_m[0], tools.jaw_angle_rad[0] = True, AWAY_M, 0.2
    simulation.step(tools)
    np.testing.assert_array_equal(simulation.tools.proxy[0], [*AWAY_M, 0.2])
    assert not simulation.tool_results.force_n.any()


def hold_on(simulation, tools):
    """Put tool 1 above the catheter, and return its hold."""
    tools.present[0], tools.jaw_angle_rad[1], tools.roll_rad[1] = False, 0.7, 0.5 * np.pi
    tools.position_m[1] = simulation.catheter.state.position_m[10] + np.array([0.0, 0.0, 13e-3])
    return [HOLD]


@pytest.mark.parametrize("asked_by_caller", [True, False])
def test_a_tool_that_vanishes_lets_go_of_what_it_holds_and_does_not_hold_it_when_it_is_back(
    small_scene, small_duct, asked_by_caller
):
    simulation, tools = Simulation(small_scene, small_duct), ToolInputs()
    holds = hold_on(simulation, tools)
    simulation.step(tools)
    tools.jaw_angle_rad[1] = 0.0
    if asked_by_caller:
        tools.holds = holds
    else:
        grasp = simulation.grasps[1]
        grasp.holds[:], grasp._lever_m = holds, 1e-2
    for _ in range(5):
        simulation.step(tools)
    assert list(simulation.holds.active) == [3]
    tools.present[1] = False
    simulation.step(tools)
    assert not simulation.holds.active
    assert not simulation.contact_force_n.any()
    tools.present[1], tools.jaw_angle_rad[1] = True, 0.7
    simulation.step(tools)
    assert list(simulation.holds.active) == ([3] if asked_by_caller else [])


def at_port(tools, simulation):
    tools.position_m[0] = simulation.tools.port_m[0]


UNSOUND = {
    "nan in a position": lambda tools, simulation: tools.position_m.__setitem__((0, 1), np.nan),
    "infinite position": lambda tools, simulation: tools.position_m.__setitem__((0, 2), -np.inf),
    "position whose square overflows": lambda tools, simulation: tools.position_m.__setitem__((0, 0), 1e200),
    "nan in the roll": lambda tools, simulation: tools.roll_rad.__setitem__(0, np.nan),
    "infinite roll": lambda tools, simulation: tools.roll_rad.__setitem__(0, np.inf),
    "nan in the opening": lambda tools, simulation: tools.jaw_angle_rad.__setitem__(0, np.nan),
    "infinite opening": lambda tools, simulation: tools.jaw_angle_rad.__setitem__(0, np.inf),
    "junction in the port": at_port,
}


@pytest.mark.parametrize("spoil", UNSOUND.values(), ids=UNSOUND.keys())
def test_a_tool_whose_numbers_mean_nothing_stays_where_it_was_and_is_absent_when_that_goes_on(pressed, spoil):
    simulation, tools = pressed
    before = simulation.tool_results.force_n[0].copy()
    spoil(tools, simulation)
    for tick in range(19):
        simulation.step(tools)
        assert simulation.refused_inputs == tick + 1
        np.testing.assert_allclose(simulation.tool_results.force_n[0], before, atol=0.05)
    simulation.step(tools)
    assert not simulation.tools.present[0]
    assert not simulation.tool_results.force_n.any()
    assert np.isfinite(state(simulation)).all()
    assert np.isfinite(simulation.tool_results.proxy_position_m).all()


def test_numbers_that_mean_nothing_are_not_counted_of_a_tool_that_is_gone(pressed):
    simulation, tools = pressed
    tools.present[0] = False
    tools.position_m[0] = np.nan
    simulation.step(tools)
    assert simulation.refused_inputs == 0
    assert np.isfinite(state(simulation)).all()


def test_what_a_tool_pressed_is_let_go_at_rest_when_it_vanishes(pressed):
    """A mode let go at rest comes back by (omega dt)^2 / 2 in a step, and not by as much again.

    Half the impulse of what pressed is in the wall's rates at the end of a step, and no other half comes now. What was
    left of the motion that pressed makes a third.
    """
    simulation, tools = pressed
    for _ in range(1500):  # until the wall nearly rests; the catheter in it still swings
        simulation.step(tools)
    duct = simulation.duct
    turn = 1e-3 * duct.reduced.basis.omega_rad_s
    q = duct.state.q.copy()
    pressed_far = (turn < 0.4) & (np.abs(q) > 0.1 * np.abs(q).max())
    assert pressed_far.sum() >= 2
    swung = q + 1e-3 * duct.rate()
    tools.present[0] = False
    simulation.step(tools)
    came_back = ((swung - duct.state.q) / q)[pressed_far]
    np.testing.assert_allclose(came_back, 0.5 * turn[pressed_far] ** 2, rtol=0.5)


@pytest.mark.parametrize("deeper_m", [0.0, 3e-3, 6e-3])
def test_a_tool_that_comes_back_inside_the_wall_touches_nothing_until_it_has_been_withdrawn(pressed, deeper_m):
    """One that comes back with its tips in the lumen is not in its right place there: it goes out through the wall."""
    simulation, tools = pressed
    pressing_m = tools.position_m[0].copy()
    tools.present[0] = False
    for _ in range(100):
        simulation.step(tools)
    tools.present[0] = True
    tools.position_m[0, 2] -= deeper_m
    for _ in range(50):
        simulation.step(tools)
        assert not simulation.tool_results.force_n.any()
    for lifted_m in np.linspace(0.0, deeper_m + 6e-3, 100):
        tools.position_m[0] = np.add(pressing_m, (0.0, 0.0, lifted_m - deeper_m))
        simulation.step(tools)
        assert np.abs(simulation.tool_results.force_n).max() < 1e-3
    for lifted_m in np.linspace(6e-3, 0.0, 150):
        tools.position_m[0] = np.add(pressing_m, (0.0, 0.0, lifted_m))
        simulation.step(tools)
    assert np.linalg.norm(simulation.tool_results.force_n[0]) > 0.05


def test_jaws_are_not_opened_by_what_they_hold(small_scene, small_duct):
    """They have closed by another tick when the hold begins."""
    simulation, tools = Simulation(small_scene, small_duct), ToolInputs()
    holds = hold_on(simulation, tools)
    tools.jaw_angle_rad[1] = 0.65  # the hold stops them at 0.7
    simulation.step(tools)
    tools.holds = holds
    openings = []
    for _ in range(5):
        simulation.step(tools)
        openings.append(simulation.tools.proxy[1, 3])
    assert list(simulation.holds.active) == [3]
    assert max(openings) <= 0.65


@pytest.mark.parametrize(
    "spoilt",
    [
        {"limit_n": np.nan},
        {"limit_n": -1.0},
        {"jaw_angle_rad": np.inf},
        {"target_weights": np.array([np.nan, 0.0, 0.0])},
        {"target_weights": np.array([1.0 - 1e200, 1e200, 0.0])},
        {"target_weights": np.array([2.0, -1.0, 0.0])},
        {"target_weights": np.array([0.5, 0.0, 0.0])},
        {"target": -1},
        {"target": 30},
        {"target": 10**6, "target_kind": DUCT_TRIANGLE},
        {"target_kind": 2},
        {"tool": 2},
        {"tool": -1},
    ],
)
def test_a_hold_whose_numbers_mean_nothing_is_none(small_scene, small_duct, spoilt):
    simulation, tools = Simulation(small_scene, small_duct), ToolInputs()
    tools.holds = hold_on(simulation, tools)
    simulation.step(tools)
    tools.holds = [replace(HOLD, **spoilt)]
    simulation.step(tools)
    assert simulation.refused_inputs == 1
    assert not simulation.holds.active
    tools.holds = [HOLD]
    for _ in range(5):
        simulation.step(tools)
    assert list(simulation.holds.active) == [3]
    assert np.isfinite(state(simulation)).all()
    assert np.isfinite(simulation.tool_results.force_n).all()


def test_a_hold_by_a_tool_that_the_scene_does_not_name_is_none(small_scene, small_duct):
    simulation, tools = Simulation(replace(small_scene, forceps=small_scene.forceps[:1]), small_duct), ToolInputs()
    tools.present[1], tools.holds = True, [HOLD]
    simulation.step(tools)
    assert not simulation.holds.active


def everything(simulation):
    return np.concatenate([state(simulation), simulation.tools.proxy.ravel(), simulation.tools.hand.ravel()])


CALLS = {
    "position_m": [np.zeros(3), np.zeros((1, 3)), np.zeros((3, 3)), np.zeros((2, 3), np.float32), [[0.0] * 3] * 2],
    "present": [np.ones(3, np.bool_), np.ones(1, np.bool_), np.ones(2), [True, False], None],
    "roll_rad": [np.zeros(1), np.zeros(3), 0.1, np.zeros(2, np.int64), np.zeros(4)[::2]],
    "jaw_angle_rad": [np.zeros((2, 1)), None],
    "holds": [
        3,
        [None],
        {3: HOLD},
        *([replace(HOLD, **wrong)] for wrong in ({"tool": 1.5}, {"target": "4"}, {"limit_n": None})),
        *([replace(HOLD, target_weights=each)] for each in ((1.0, 0.0, 0.0), np.ones(2), np.ones(3, np.int64))),
    ],
}


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in CALLS.items() for value in values])
def test_arrays_of_another_kind_are_refused_by_name_before_anything_moves(pressed, name, value):
    simulation, tools = pressed
    before, good = everything(simulation), getattr(tools, name)
    setattr(tools, name, value)
    for _ in range(2):
        with pytest.raises((TypeError, ValueError), match=rf"^tools\.{name}"):
            simulation.step(tools)
    np.testing.assert_array_equal(everything(simulation), before)
    setattr(tools, name, good)
    simulation.step(tools)
    assert simulation.refused_inputs == 0


@pytest.mark.parametrize("tools", [None, [1]])
def test_what_is_no_input_at_all_is_refused(pressed, tools):
    with pytest.raises(TypeError, match="must be"):
        pressed[0].step(tools)


@pytest.mark.parametrize("dt_s", [0.0, -1e-3, np.nan, np.inf])
def test_a_tick_without_a_length_is_refused_before_anything_moves(pressed, dt_s):
    simulation, tools = pressed
    before = state(simulation)
    tools.present[0] = False
    with pytest.raises(ValueError, match="dt_s must be positive and finite"):
        simulation.step(tools, dt_s=dt_s)
    np.testing.assert_array_equal(state(simulation), before)
    assert simulation.tools.present.all()


def test_a_tick_that_is_too_long_is_refused(pressed):
    simulation, tools = pressed
    with pytest.raises(ValueError, match=r"dt_s must be at most 1 s, is 1e\+300"):
        simulation.step(tools, dt_s=1e300)


def test_a_long_tick_is_taken_in_steps_that_are_none(small_scene, small_duct):
    long, short = (Simulation(small_scene, small_duct) for _ in range(2))
    tools = ToolInputs()
    tools.present[:] = False
    for simulation in (long, short):
        simulation.catheter.state.velocity_m_s[:, 2] = np.linspace(0.0, 0.2, 31)
    for _ in range(5):
        long.step(tools, dt_s=8e-3)
        for _ in range(8):
            short.step(tools)
    np.testing.assert_array_equal(state(long), state(short))
