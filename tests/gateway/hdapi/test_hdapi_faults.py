"""What goes wrong with a library, its scheduler, an arm or the gateway, and what each hand feels of it."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from tests.gateway.hdapi.hdapi_bench import FREE, LEFT, RATE_N_S, RIGHT, STEP_N, TTL_MS, HdapiBench
from trocar.services.gateway.hdapi import native
from trocar.services.gateway.hdapi.constants import ERRORS, Style
from trocar.services.gateway.hdapi.library import Library
from trocar.services.gateway.servo import servo_arrays
from trocar.services.gateway.servo.engagement import SMALL_FORCE_N
from trocar.services.mechanics.compiled import kernel

REFUSALS, SCHEDULER, WARM = (0x0201, 0x0202, 0x0203, 0x0204), (0x0304, 0x0500, 0x0501), 0x0200
UNKNOWN = 0x0777
LATCHED = [*sorted(set(ERRORS) - {*REFUSALS, *SCHEDULER, WARM}), UNKNOWN]


@pytest.mark.parametrize("code", [*REFUSALS, WARM], ids=hex)
def test_a_refusal_of_force_is_survived(pushing: HdapiBench, code: int) -> None:
    pushing.c.standin_inject(1, code)
    pushing.run(150, LEFT, RIGHT)
    left, right = pushing.forces[-1]
    np.testing.assert_array_equal(left, LEFT if code == WARM else FREE)  # it does not begin in the middle of a contact
    np.testing.assert_array_equal(right, RIGHT)
    assert pushing.left.fault == ""
    assert ("the arm 'Left' has refused force" in pushing.left.prompt) == (code != WARM)
    pushing.begin(LEFT, RIGHT)
    assert pushing.left.prompt == ""
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])
    assert pushing.largest_step_n() <= STEP_N


@pytest.mark.parametrize("code", REFUSALS, ids=hex)
def test_an_arm_that_refuses_force_all_the_time_is_a_fault(pushing: HdapiBench, code: int) -> None:
    pushing.c.standin_inject_every(1, code)
    pushing.run(250, LEFT, RIGHT)
    assert f"the arm 'Left' refuses force again and again: {ERRORS[code][0]}" in pushing.left.fault
    np.testing.assert_allclose(pushing.forces[-1], [FREE, RIGHT])


@pytest.mark.parametrize("code", LATCHED, ids=hex)
def test_any_other_error_lets_one_arm_go_until_the_rig_is_armed_and_the_other_goes_on(
    pushing: HdapiBench, code: int
) -> None:
    pushing.c.standin_inject(1, code)
    pushing.run(TTL_MS, LEFT, RIGHT)
    assert ERRORS.get(code, ("HD error 0x0777",))[0] in pushing.left.fault
    pushing.run(300, LEFT, RIGHT)
    np.testing.assert_array_equal(pushing.forces[-301][0], 0.0)  # within ttl_s
    np.testing.assert_array_equal(pushing.forces[-1], [FREE, RIGHT])
    np.testing.assert_array_equal([right for _, right in pushing.forces[-300:]], [RIGHT] * 300)
    assert not pushing.standin.look(1).motors_on
    assert pushing.right.fault == ""
    pushing.left.clear_fault()
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])
    assert pushing.left.fault == ""
    assert pushing.largest_step_n() <= STEP_N


@pytest.mark.parametrize("code", SCHEDULER, ids=hex)
def test_an_error_of_the_scheduler_lets_both_go_and_ends_the_callback(pushing: HdapiBench, code: int) -> None:
    pushing.c.standin_inject(1, code)
    pushing.run(TTL_MS, LEFT, RIGHT)
    np.testing.assert_array_equal(pushing.forces[-1], [FREE, FREE])
    assert pushing.largest_step_n() <= STEP_N
    assert not pushing.standin.look(1).scheduled
    for driver in (pushing.left, pushing.right):
        assert f"the scheduler of OpenHaptics has ended: {ERRORS[code][0]}" in driver.fault


def test_an_error_counts_for_the_arm_that_it_names(pushing: HdapiBench) -> None:
    pushing.c.standin_raise(0x0302, 2)  # found on the stack in the left arm's turn
    pushing.run(TTL_MS, LEFT, RIGHT)
    assert pushing.left.fault == ""
    assert "the arm 'Right' reports HD_COMM_ERROR" in pushing.right.fault
    np.testing.assert_array_equal(pushing.forces[-1], [LEFT, FREE])


def test_the_error_stack_is_empty_after_every_frame(pushing: HdapiBench) -> None:
    for _ in range(20):
        pushing.c.standin_raise(0x0201, 1)
    pushing.run(2, LEFT, RIGHT)
    assert Library(str(pushing.standin.path), "here").take_error() == 0


def test_an_unplugged_arm_is_left_alone_and_comes_back_when_the_rig_is_armed(pushing: HdapiBench) -> None:
    pushing.c.standin_unplug(1, 1)
    read = pushing.readings[pushing.left].copy()
    pushing.standin.put("place", 1, np.array([0.0, 0.3, 0.0]))
    pushing.run(40, LEFT, RIGHT)
    np.testing.assert_allclose(pushing.readings[pushing.left][:3], read[:3], atol=1e-3)  # a failed frame says nothing
    assert "HD_COMM_ERROR" in pushing.left.fault
    frames = pushing.standin.look(1).frames
    pushing.run(100, LEFT, RIGHT)
    assert pushing.standin.look(1).frames == frames, "nobody waits for an arm that is gone"
    np.testing.assert_array_equal(pushing.forces[-1][1], RIGHT)
    pushing.c.standin_unplug(1, 0)
    pushing.run(10, LEFT, RIGHT)
    assert pushing.left.fault, "not by itself"
    pushing.left.clear_fault()
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])


def test_a_gateway_that_falls_silent_leaves_limp_arms_within_a_models_life(pushing: HdapiBench) -> None:
    pushing.wait(TTL_MS)
    np.testing.assert_array_equal(pushing.forces[-1], [FREE, FREE])
    np.testing.assert_array_equal(pushing.forces[-TTL_MS], [LEFT, RIGHT])  # a tick that comes late is no reason
    pushing.run(150, LEFT, RIGHT)
    np.testing.assert_array_equal(pushing.forces[-1], [FREE, FREE])  # not in the middle of a contact
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])
    assert pushing.largest_step_n() <= STEP_N


@pytest.mark.parametrize("code", [*REFUSALS, WARM, *LATCHED], ids=hex)
def test_no_error_makes_an_arm_give_more_than_it_was_given(arms: HdapiBench, code: int) -> None:
    """A hand presses into a spring and comes back, again and again, while force is refused and comes back.

    It may come back where less than SMALL_FORCE_N is asked for: with what a spring that is held so holds, no more.
    """
    stiffness_n_m = 400.0
    arms.bound()
    arms.open()
    arms.run(300, FREE, FREE)
    taken_j, returns = 0.0, 0
    for k in range(2000):
        arms.standin.put("hand", 1, np.array([0.0, -0.006 * np.sin(4 * np.pi * 1e-3 * k) ** 2, 0.0]))
        if k % 137 == 0:
            arms.c.standin_inject(1, code)
            returns += code != WARM
        if k % 411 == 300:
            arms.left.clear_fault()
        arms.left.read(0, arms.readings[arms.left])
        arms.order(arms.left, np.zeros(3), stiffness_n_m)
        taken_j += arms.taken_in_a_tick_j()
    assert taken_j < 1e-4 + returns * 0.5 * SMALL_FORCE_N**2 / stiffness_n_m
    assert arms.largest_step_n() <= STEP_N


def test_the_law_goes_on_from_the_force_that_was_applied(arms: HdapiBench) -> None:
    arms.by_law = True
    arms.open()
    arms.begin(LEFT, RIGHT)
    arms.c.standin_inject(1, REFUSALS[0])
    arms.run(5, LEFT, RIGHT)
    np.testing.assert_allclose(arms.memories[arms.left][servo_arrays.MEMORY_FORCE :][:3], arms.forces[-2][0])
    arms.run(20, LEFT, RIGHT)
    np.testing.assert_array_equal(arms.memories[arms.left][servo_arrays.MEMORY_FORCE :][:3], FREE)


def test_what_the_law_refuses_is_counted_with_what_the_torque_refuses(arms: HdapiBench) -> None:
    arms.by_law = True
    arms.open()
    memory = arms.memories[arms.left]
    memory[servo_arrays.MEMORY_REFUSED] += 5.0  # by the torque's law, in the gateway
    memory[servo_arrays.MEMORY_TORQUE] = 0.1
    arms.run(10, (0.0, np.nan, 0.0), RIGHT)
    arms.run(3, LEFT, RIGHT)
    assert memory[servo_arrays.MEMORY_REFUSED] == 15.0
    assert memory[servo_arrays.MEMORY_TORQUE] == 0.1


@pytest.mark.parametrize("nonsense", [np.nan, np.inf])
def test_an_order_that_is_no_number_is_none(pushing: HdapiBench, nonsense: float) -> None:
    pushing.run(TTL_MS, (0.0, nonsense, 0.0), RIGHT)
    np.testing.assert_array_equal(pushing.forces[-1], [FREE, RIGHT])
    assert np.isfinite(pushing.forces).all()
    assert pushing.largest_step_n() <= STEP_N


def test_a_huge_order_is_held_to_what_the_device_can_bear(pushing: HdapiBench) -> None:
    pushing.run(100, (0.0, 0.0, 1e9), RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [(0.0, 0.0, 3.3), RIGHT], atol=1e-12)
    assert pushing.left.fault == ""


def test_a_pose_that_is_no_number_is_not_passed_on(pushing: HdapiBench) -> None:
    pushing.c.standin_not_a_number(1, 1)
    pushing.run(10, LEFT, RIGHT)
    assert np.isfinite(pushing.readings[pushing.left]).all()
    pushing.run(20, LEFT, RIGHT)
    assert "nothing was read of the arm 'Left' for 20 ms" in pushing.left.fault
    np.testing.assert_array_equal(pushing.forces[-1], [FREE, RIGHT])


@pytest.mark.parametrize("frames", [6, 19])
def test_a_hand_is_told_why_it_bears_no_force_after_some_poses_that_were_no_numbers(
    pushing: HdapiBench, frames: int
) -> None:
    pushing.c.standin_not_a_number(1, 1)
    pushing.run(frames, LEFT, RIGHT)
    pushing.c.standin_not_a_number(1, 0)
    pushing.run(100, LEFT, RIGHT)
    np.testing.assert_array_equal(pushing.forces[-1], [FREE, RIGHT])
    assert pushing.left.prompt.endswith("bears no force: move out of the contact")
    assert pushing.left.fault == pushing.right.prompt == ""
    pushing.begin(LEFT, RIGHT)
    assert pushing.left.prompt == ""


def test_a_scheduler_that_stalls_for_a_moment_is_survived_and_earns_no_step(pushing: HdapiBench) -> None:
    pushing.run(50, LEFT, RIGHT)
    pushing.c.standin_stall(10)
    pushing.run(12, FREE, RIGHT)
    assert pushing.left.fault == ""
    assert pushing.largest_step_n() <= RATE_N_S * 3e-3 + 1e-12
    assert pushing.left.arm is not None
    assert pushing.left.arm.cell.late == 1


def test_a_scheduler_that_stalls_for_long_is_a_fault(pushing: HdapiBench) -> None:
    pushing.c.standin_stall(1000)
    pushing.run(30, LEFT, RIGHT)
    for driver in (pushing.left, pushing.right):
        assert "nothing was read of" in driver.fault


def test_a_process_that_was_stopped_as_a_whole_has_no_fault(pushing: HdapiBench) -> None:
    pushing.c.standin_stall(500)
    pushing.wait(500)
    pushing.run(5, LEFT, RIGHT)
    assert pushing.left.fault == pushing.right.fault == ""


def test_a_lost_calibration_is_a_fault(pushing: HdapiBench) -> None:
    pushing.c.standin_style(1, int(Style.INKWELL))  # which it cannot find again by itself
    pushing.c.standin_uncalibrate(1)
    pushing.run(1100, LEFT, RIGHT)
    assert "the arm 'Left' has lost its calibration" in pushing.left.fault
    np.testing.assert_array_equal(pushing.forces[-1], [FREE, RIGHT])


STALLED_TICKS, SILENT_TICKS = 10, 15


@pytest.mark.parametrize("drill", ["unplugged", "not a number", "silent gateway", "stalled"])
def test_no_failure_of_the_line_makes_an_arm_give_more_than_it_was_given(arms: HdapiBench, drill: str) -> None:
    """The same hand and books as with errors; an arm that comes back does so where little is asked for."""
    stiffness_n_m, times, taken_j = 400.0, 0, 0.0
    arms.bound()
    arms.open()
    arms.run(300, FREE, FREE)
    silent_until = 0
    for k in range(2000):
        arms.standin.put("hand", 1, np.array([0.0, -0.006 * np.sin(4 * np.pi * 1e-3 * k) ** 2, 0.0]))
        begins, ends = k % 137 == 60, k % 137 == 90
        times += begins
        if drill == "unplugged" and (begins or ends):
            arms.c.standin_unplug(1, int(begins))
        elif drill == "not a number" and (begins or ends):
            arms.c.standin_not_a_number(1, int(begins))
        elif drill == "silent gateway" and begins:
            silent_until = k + SILENT_TICKS
        elif drill == "stalled" and begins:
            arms.c.standin_stall(STALLED_TICKS)
        if k % 137 == 100:
            arms.left.clear_fault()
        if k >= silent_until:
            arms.left.read(0, arms.readings[arms.left])
            arms.order(arms.left, np.zeros(3), stiffness_n_m)
        taken_j += arms.taken_in_a_tick_j()
    assert np.abs(arms.forces).max() > 0.5
    assert taken_j < 1e-4 + times * 0.5 * SMALL_FORCE_N**2 / stiffness_n_m


def test_a_clock_that_goes_back_moves_no_force_by_more_than_its_rate(arms: HdapiBench) -> None:
    """By 50 ms, again and again, while a hand presses into a spring."""
    arms.bound()
    arms.open()
    arms.run(300, FREE, FREE)
    taken_j, clock = 0.0, arms.standin.clock
    for k in range(600):
        arms.standin.put("hand", 1, np.array([0.0, -0.006 * np.sin(4 * np.pi * 1e-3 * k) ** 2, 0.0]))
        if k % 100 == 90:
            arms.c.standin_tick(ctypes.c_int64(clock.monotonic_ns() - 50_000_000))
        arms.left.read(0, arms.readings[arms.left])
        arms.order(arms.left, np.zeros(3), 400.0)
        taken_j += arms.taken_in_a_tick_j()
    assert np.isfinite(arms.forces).all()
    assert np.abs(arms.forces).max() > 0.5
    assert arms.largest_step_n() <= STEP_N
    assert taken_j < 1e-4


@pytest.mark.parametrize("by_law", [False, True])
def test_a_clock_that_goes_back_does_not_keep_the_force_of_a_gateway_that_falls_silent(
    arms: HdapiBench, by_law: bool
) -> None:
    arms.by_law = by_law
    arms.open()
    arms.begin(LEFT, RIGHT)
    arms.standin.clock._now_ns -= 2_000_000_000
    arms.wait(2 * TTL_MS)
    np.testing.assert_array_equal(arms.forces[-1], [FREE, FREE])


def test_of_two_threads_only_one_serves_the_arms() -> None:
    busy = np.zeros(1, np.int64)
    assert [bool(_claims(busy.ctypes.data)) for _ in range(2)] == [True, False]


@kernel
def _claims(address: int) -> bool:
    return native.claim(address)


def test_a_call_from_a_second_thread_while_one_is_served_does_nothing(pushing: HdapiBench) -> None:
    assert pushing.left._session is not None
    servo = pushing.left._session._servo
    assert servo is not None
    servo.busy[0] = 1
    calls = servo.calls
    pushing.wait(3)
    assert servo.calls == calls
    servo.busy[0] = 0
    pushing.wait(3)
    assert servo.calls == calls + 3
