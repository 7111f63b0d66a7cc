"""An arm whose handle the library forgets as it is pulled out: the other goes on; arming the rig opens it anew."""

from __future__ import annotations

import time

import numpy as np
import pytest

from tests.gateway.hdapi.hdapi_bench import FREE, LEFT, RIGHT, STEP_N, TTL_MS, HdapiBench
from tests.patience import PATIENCE_S
from trocar.services.gateway.drivers.phantom_hdapi import Driver
from trocar.services.gateway.hdapi.constants import TIMER_ERROR, Style
from trocar.services.gateway.servo import servo_arrays


def pull_out(arms: HdapiBench, *devices: int) -> None:
    """Pull arms out under force; what they push ends with them, all else is watched from now on."""
    for device in devices:
        arms.c.standin_pull(device)
    arms.run(100, LEFT, RIGHT)
    arms.forces.clear()


def run_until_opened(arms: HdapiBench, device: int, driver: Driver, openings: int = 2) -> None:
    """Exchange until an arm has been opened so often and its driver has heard of it; a tick is not waited for."""
    until = time.monotonic() + PATIENCE_S
    while arms.standin.look(device).openings < openings or driver.is_reopening:
        assert time.monotonic() < until, f"{driver.fault}; {driver.prompt}"
        arms.run(1, LEFT, RIGHT)
        time.sleep(1e-4)


def test_an_arm_that_is_pulled_out_leaves_the_other_alone(pushing: HdapiBench) -> None:
    pushing.c.standin_pull(1)
    n = len(pushing.forces)
    pushing.run(300, LEFT, RIGHT)
    assert "the arm 'Left' reports HD_BAD_HANDLE" in pushing.left.fault
    assert pushing.right.fault == ""
    np.testing.assert_array_equal([right for _, right in pushing.forces[n:]], [RIGHT] * 300)
    np.testing.assert_array_equal(pushing.forces[-1][0], FREE)
    assert not pushing.memories[pushing.left][servo_arrays.MEMORY_FORCE :][:3].any(), "the law goes on from no force"


def test_an_arm_that_was_pulled_out_is_opened_anew_once_it_is_there_and_armed(pushing: HdapiBench) -> None:
    pull_out(pushing, 1)
    pushing.c.standin_unplug(1, 0)
    pushing.run(100, LEFT, RIGHT)
    assert pushing.standin.look(1).openings == 1, "not by itself"
    pushing.left.clear_fault()
    run_until_opened(pushing, 1, pushing.left)
    assert pushing.left.fault == pushing.right.fault == ""
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])
    assert pushing.left.fault == pushing.left.prompt == pushing.right.fault == pushing.right.prompt == ""
    assert pushing.largest_step_n() <= STEP_N
    assert pushing.standin.look(2).openings == 1
    assert pushing.standin.look(2).dropped == 0, "what the other pushed was let go before the scheduler stopped"


def test_an_arm_that_is_not_there_yet_is_one_sentence_and_can_be_armed_again(pushing: HdapiBench) -> None:
    pull_out(pushing, 1)
    for _ in range(2):
        pushing.left.clear_fault()
        run_until_opened(pushing, 1, pushing.left, openings=1)
        pushing.run(30, LEFT, RIGHT)
        assert "device 'Left' cannot be opened: HD_DEVICE_FAULT" in pushing.left.fault
        assert pushing.right.fault == ""
        pushing.begin(LEFT, RIGHT)
        np.testing.assert_allclose(pushing.forces[-1], [FREE, RIGHT])
    pushing.c.standin_unplug(1, 0)
    pushing.left.clear_fault()
    run_until_opened(pushing, 1, pushing.left)
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])
    assert pushing.largest_step_n() <= STEP_N


def test_two_arms_that_were_pulled_out_together_come_back_together(pushing: HdapiBench) -> None:
    pull_out(pushing, 1, 2)
    for device, driver in ((1, pushing.left), (2, pushing.right)):
        pushing.c.standin_unplug(device, 0)
        driver.clear_fault()
    run_until_opened(pushing, 1, pushing.left)
    run_until_opened(pushing, 2, pushing.right)
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])
    assert pushing.left.fault == pushing.right.fault == ""


def test_while_an_arm_is_opened_nobody_waits_and_both_hands_are_free(pushing: HdapiBench) -> None:
    pull_out(pushing, 1)
    pushing.c.standin_unplug(1, 0)
    pushing.c.standin_init_ms(600_000)  # until it is told otherwise
    pushing.left.clear_fault()
    pushing.run(TTL_MS, LEFT, RIGHT)
    for _ in range(100):
        pushing.run(1, LEFT, RIGHT)
        assert "the arm 'Left' is being opened anew" in pushing.left.prompt
        assert pushing.left.fault == pushing.right.fault == ""
        np.testing.assert_array_equal(pushing.forces[-1], [FREE, FREE])
    assert not pushing.left.calibrated
    pushing.c.standin_init_ms(0)
    run_until_opened(pushing, 1, pushing.left)
    assert pushing.left.fault == pushing.right.fault == ""
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])


def run_until_opening(arms: HdapiBench, driver: Driver) -> None:
    """Exchange until the thread that opens an arm has begun."""
    for _ in range(10 * TTL_MS):
        if driver._reopening is not None and driver._reopening._opening is not None:
            return
        arms.run(1, LEFT, RIGHT)
    pytest.fail(f"it is not opened: {driver.fault}; {driver.prompt}")


def wait_for_the_library(driver: Driver) -> None:
    """Wait until that thread has ended: how long the machine keeps it from that is not the test's."""
    reopening = driver._reopening
    opening = None if reopening is None else reopening._opening
    until = time.monotonic() + PATIENCE_S
    while opening is not None and not opening.done:
        assert time.monotonic() < until
        time.sleep(1e-3)


@pytest.mark.parametrize("begun", [False, True])
def test_a_gateway_that_ends_meanwhile_ends_cleanly(pushing: HdapiBench, begun: bool) -> None:
    pull_out(pushing, 1)
    pushing.c.standin_unplug(1, 0)
    pushing.c.standin_init_ms(100)
    pushing.left.clear_fault()
    pushing.run(TTL_MS if begun else 1, LEFT, RIGHT)
    pushing.left.close()
    pushing.right.close()
    assert not pushing.standin.look(2).motors_on
    pushing.c.standin_init_ms(0)
    pushing.open()
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])


def test_a_loose_cable_that_makes_contact_again_costs_the_other_hand_nothing(pushing: HdapiBench) -> None:
    """The library kept its handle: nothing is opened, nothing is stopped."""
    pushing.c.standin_unplug(1, 1)
    pushing.run(50, LEFT, RIGHT)
    pushing.c.standin_unplug(1, 0)
    pushing.forces.clear()
    pushing.left.clear_fault()
    pushing.run(50, LEFT, RIGHT)
    np.testing.assert_array_equal([right for _, right in pushing.forces], [RIGHT] * 50)
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])
    assert pushing.standin.look(1).openings == 1
    assert pushing.largest_step_n() <= STEP_N


def test_a_handle_that_is_unknown_for_one_frame_lets_the_hand_go_at_the_rate_limit(pushing: HdapiBench) -> None:
    pushing.c.standin_forget(1, 1)
    pushing.run(1, LEFT, RIGHT)
    pushing.c.standin_forget(1, 0)
    pushing.run(TTL_MS, LEFT, RIGHT)
    np.testing.assert_array_equal(pushing.forces[-1], [FREE, RIGHT])
    assert pushing.largest_step_n() <= STEP_N
    assert "HD_BAD_HANDLE" in pushing.left.fault


def test_arming_to_open_an_arm_anew_says_nothing_of_its_reset_posture(pushing: HdapiBench) -> None:
    pushing.c.standin_style(1, int(Style.ENCODER_RESET))
    pull_out(pushing, 1)
    pushing.c.standin_unplug(1, 0)
    calibrations = pushing.standin.look(1).calibrations
    pushing.left.clear_fault()
    run_until_opening(pushing, pushing.left)
    wait_for_the_library(pushing.left)
    pushing.wait(TTL_MS)  # its scheduler may call before the gateway has said a word to the arm
    run_until_opened(pushing, 1, pushing.left)
    pushing.begin(LEFT, RIGHT)
    assert pushing.standin.look(1).calibrations == calibrations
    assert "hold the arm in its reset posture" in pushing.left.prompt
    pushing.left.clear_fault()
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])


def test_a_scheduler_that_has_ended_is_started_again_when_the_rig_is_armed(pushing: HdapiBench) -> None:
    pushing.c.standin_inject(1, TIMER_ERROR)
    pushing.run(100, LEFT, RIGHT)
    assert not pushing.standin.look(1).scheduled
    for driver in (pushing.left, pushing.right):
        assert "the scheduler of OpenHaptics has ended: HD_TIMER_ERROR" in driver.fault
        driver.clear_fault()
    run_until_opened(pushing, 1, pushing.left, openings=1)
    run_until_opened(pushing, 2, pushing.right, openings=1)
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])
    assert pushing.left.fault == pushing.right.fault == ""
    assert pushing.largest_step_n() <= STEP_N


def test_an_arm_that_is_pulled_out_and_opened_anew_gives_no_energy(arms: HdapiBench) -> None:
    """A hand presses into a spring and comes back while its arm is pulled out and opened anew, and the other's is."""
    stiffness_n_m, taken_j, pulls = 400.0, 0.0, 0
    arms.bound()
    arms.open()
    arms.run(300, FREE, FREE)
    for k in range(2400):
        arms.standin.put("hand", 1, np.array([0.0, -0.006 * np.sin(4 * np.pi * 1e-3 * k) ** 2, 0.0]))
        device, driver = ((1, arms.left), (2, arms.right))[k // 400 % 2]
        if k % 400 == 60:
            arms.c.standin_pull(device)
            pulls += 1
        if k % 400 == 130:
            arms.c.standin_unplug(device, 0)
            driver.clear_fault()
        for each in (arms.left, arms.right):
            each.read(0, arms.readings[each])
            arms.order(each, np.zeros(3), stiffness_n_m)
        if driver.is_reopening and k % 400 < 160:
            time.sleep(1e-3)
        elif driver.is_reopening:
            wait_for_the_library(driver)
        taken_j += arms.taken_in_a_tick_j()
    assert np.abs(arms.forces[-400:]).max() > 0.5, "it came back"
    assert taken_j < 1e-4 + pulls * 0.5 * 0.3**2 / stiffness_n_m
