"""The driver against a stand-in of the library, in the stand-in's own time: exact to the tick."""

from __future__ import annotations

from ctypes import c_double
from pathlib import Path

import numpy as np
import pytest

from tests.gateway.hdapi.hdapi_bench import FREE, LEFT, RIGHT, STEP_N, HdapiBench, two_arms
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.drivers import load_arm
from trocar.services.gateway.hdapi.constants import ERRORS, WARM_MOTORS, Style
from trocar.services.gateway.servo import servo_arrays
from trocar.services.runtime.config.rig import DriverSettings, Mount
from trocar.services.runtime.errors import DeviceError


def test_axes_and_units(arms: HdapiBench) -> None:
    arms.open()
    arms.standin.put("place", 1, np.array([0.01, 0.02, 0.03]))  # right, up, toward the user
    arms.run(2, FREE, FREE)
    reading = arms.readings[arms.left]
    np.testing.assert_allclose(reading[:3], [0.03, 0.01, 0.02])  # toward the user, right, up
    arms.begin((0.0, 0.0, 0.5), FREE)
    np.testing.assert_allclose(arms.standin.look(1).force_n, [0.0, 0.5, 0.0])
    assert arms.readings[arms.left][2] > 0.0201, "a force upward lifts the hand"


def test_the_middle_of_a_premiums_workspace_is_where_its_device_file_says(tmp_path: Path) -> None:
    with two_arms(tmp_path, "phantom_premium_1_5") as bench:
        bench.open()
        bench.standin.put("place", 1, np.array([0.0, 0.1, 0.0]))
        bench.run(2, FREE, FREE)
        np.testing.assert_allclose(bench.readings[bench.left][:3], 0.0, atol=1e-12)


def test_velocity_is_that_of_the_hand(arms: HdapiBench) -> None:
    arms.open()
    for k in range(200):
        arms.standin.put("hand", 1, np.array([0.0, 2e-4 * k, 0.0]))  # 0.2 m/s upward
        arms.run(1, FREE, FREE)
    assert arms.readings[arms.left][servo_arrays.READ_VELOCITY + 2] == pytest.approx(0.2, rel=0.02)
    np.testing.assert_allclose(arms.readings[arms.left][[3, 4]], 0.0, atol=1e-9)


def test_two_arms_are_served_by_one_callback_and_get_each_their_own(pushing: HdapiBench) -> None:
    frames = [pushing.standin.look(device).frames for device in (1, 2)]
    pushing.run(50, LEFT, RIGHT)
    assert [pushing.standin.look(device).frames for device in (1, 2)] == [frames[0] + 50, frames[1] + 50]
    assert pushing.standin.look(0).frames == 0
    assert pushing.largest_step_n() <= STEP_N
    assert pushing.left.fault == pushing.right.fault == ""


@pytest.mark.parametrize("share", [0.85, 1.15])
@pytest.mark.parametrize(("by_law", "delay_ticks"), [(False, 1.0), (True, 0.0)])
def test_a_wall_is_as_stiff_as_its_delay_allows(
    arms: HdapiBench, by_law: bool, delay_ticks: float, share: float
) -> None:
    """K < b / (T / 2 + delay): a law has none, a force is one tick old; docs/decisions/hdapi-callback.md."""
    damping_n_s_m, tick_s = 5.1, 1e-3  # of hand and arm, in arm.c
    wall_n_m = share * damping_n_s_m / ((0.5 + delay_ticks) * tick_s)
    arms.by_law = by_law
    arms.open()
    arms.run(300, FREE, FREE)
    arms.standin.put("place", 1, np.array([0.0, 1e-5, 0.0]))
    heights, reading = [], arms.readings[arms.left]
    for _ in range(600):
        arms.left.read(0, reading)
        arms.order(arms.left, np.array([0.0, 0.0, -wall_n_m * reading[2] * (not by_law)]), wall_n_m)
        arms.wait(1)
        heights.append(arms.standin.look(1).position_m[1])
    early, late = np.ptp(heights[50:150]), np.ptp(heights[500:])
    assert (late < 0.5 * early) == (share < 1.0)
    assert (late > 2.0 * early) == (share > 1.0)


def test_a_law_is_evaluated_in_the_world_at_the_present_pose(tmp_path: Path) -> None:
    """The arm is turned by 90 degrees and moved: toward its user is the world's y."""
    with two_arms(tmp_path) as bench:
        bench.by_law = True
        bench.left = bench.driver("left", Mount(centre_m=(0.1, 0.2, 0.3), yaw_rad=np.pi / 2))
        bench.readings = {bench.left: np.zeros(servo_arrays.READ_SIZE)}
        bench.memories = {bench.left: np.zeros(servo_arrays.MEMORY_SIZE)}
        bench.open()
        for _ in range(300):
            bench.standin.put("place", 1, np.array([0.0, 0.0, 0.01]))  # of HDAPI: toward the user
            bench.left.read(0, bench.readings[bench.left])
            bench.order(bench.left, np.zeros(3), stiffness_n_m=0.5)
            bench.wait(1)
        memory = bench.memories[bench.left]
        world_m, force_n = memory[servo_arrays.MEMORY_POSITION :][:3], memory[servo_arrays.MEMORY_FORCE :][:3]
        np.testing.assert_allclose(world_m, [0.1, 0.21, 0.3], atol=1e-4)  # the force moves it within the tick
        np.testing.assert_allclose(force_n, -0.5 * world_m)
        np.testing.assert_allclose(bench.forces[-1][0], [-0.105, 0.05, -0.15], atol=1e-4)


def test_motor_temperature_is_that_of_the_warmest_motor(pushing: HdapiBench) -> None:
    pushing.c.standin_heat(1, c_double(0.8))
    pushing.run(2, LEFT, RIGHT)
    assert pushing.readings[pushing.left][servo_arrays.READ_TEMPERATURE] == pytest.approx(0.8, rel=1e-3)
    pushing.c.standin_inject_every(1, WARM_MOTORS)
    pushing.run(3, LEFT, RIGHT)
    assert pushing.readings[pushing.left][servo_arrays.READ_TEMPERATURE] == 1.0
    assert pushing.left.fault == ""


def test_roll_counts_as_the_rigs_does_where_the_arm_measures_it(arms: HdapiBench) -> None:
    arms.c.standin_lack(2, 0x2150)
    arms.open()
    for reading in arms.readings.values():
        reading[servo_arrays.READ_ROLL] = 0.7
    arms.run(2, FREE, FREE)
    assert arms.readings[arms.left][servo_arrays.READ_ROLL] == -0.25  # clockwise is against the rig's roll
    assert arms.readings[arms.right][servo_arrays.READ_ROLL] == 0.7


def test_an_arm_that_knows_no_temperature_works(arms: HdapiBench) -> None:
    arms.c.standin_lack(1, 0x2605)
    arms.open()
    arms.begin(LEFT, RIGHT)
    np.testing.assert_allclose(arms.forces[-1], [LEFT, RIGHT])
    assert arms.left.fault == ""


def test_no_force_before_calibration_and_a_person_is_told_about_the_inkwell(arms: HdapiBench) -> None:
    arms.c.standin_style(1, int(Style.INKWELL))
    arms.open()
    arms.begin(LEFT, RIGHT)
    assert not arms.left.calibrated
    assert arms.left.prompt == "the arm 'Left': put the stylus into its inkwell: the arm is not calibrated"
    np.testing.assert_allclose(arms.forces[-1], [FREE, RIGHT])
    arms.c.standin_inkwell(1, 1)
    arms.begin(LEFT, RIGHT)
    assert arms.left.calibrated
    assert arms.left.prompt == arms.left.fault == ""
    np.testing.assert_allclose(arms.forces[-1], [LEFT, RIGHT])


@pytest.mark.parametrize("by_button", [True, False])
def test_encoders_are_reset_only_when_a_person_says_so(arms: HdapiBench, by_button: bool) -> None:
    arms.c.standin_style(1, int(Style.ENCODER_RESET))
    arms.open()
    arms.run(500, LEFT, RIGHT)
    assert arms.standin.look(1).calibrations == 0
    assert "hold the arm in its reset posture" in arms.left.prompt
    if by_button:
        arms.c.standin_buttons(1, 1)
    else:
        arms.left.clear_fault()
    arms.begin(LEFT, RIGHT)
    assert arms.standin.look(1).calibrations == 1
    np.testing.assert_allclose(arms.forces[-1], [LEFT, RIGHT])
    assert arms.left.buttons == int(by_button)


def test_a_button_is_heard_of_in_the_midst_of_work(pushing: HdapiBench) -> None:
    for buttons in (3, 0):
        pushing.c.standin_buttons(1, buttons)
        pushing.run(2, LEFT, RIGHT)
        assert (pushing.left.buttons, pushing.right.buttons) == (buttons, 0)


def test_closing_one_arm_leaves_the_other_and_the_last_one_stops_the_scheduler(pushing: HdapiBench) -> None:
    pushing.left.close()
    assert not pushing.standin.look(1).motors_on
    pushing.begin(LEFT, RIGHT)  # closing takes longer than the other may be left without orders
    np.testing.assert_array_equal(pushing.applied(2), RIGHT)
    pushing.right.close()
    np.testing.assert_array_equal(pushing.applied(2), 0.0)
    frames = pushing.standin.look(2).frames
    pushing.wait(10)
    assert pushing.standin.look(2).frames == frames
    pushing.open()
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])


def test_an_arm_that_was_closed_can_be_opened_while_the_other_works(pushing: HdapiBench) -> None:
    pushing.left.close()
    pushing.left.open()
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_array_equal(pushing.forces[-1], [FREE, RIGHT])
    pushing.left.enable()
    pushing.begin(LEFT, RIGHT)
    np.testing.assert_allclose(pushing.forces[-1], [LEFT, RIGHT])


@pytest.mark.parametrize("code", [0x0300, 0x0301, 0x0302, 0x0303, 0x0600], ids=hex)
def test_a_device_that_cannot_be_opened_is_one_sentence(arms: HdapiBench, code: int) -> None:
    arms.c.standin_refuse_init(code)
    with pytest.raises(DeviceError, match=f"instrument 'left': device 'Left' cannot be opened: {ERRORS[code][0]}"):
        arms.open()


def test_a_device_that_is_opened_with_an_error_is_given_back(arms: HdapiBench) -> None:
    """A handle and an error: it stayed open, and was said to be in use ever after."""
    arms.c.standin_complain_init(0x0302)
    with pytest.raises(DeviceError, match="device 'Left' cannot be opened: HD_COMM_ERROR"):
        arms.left.open()
    arms.c.standin_complain_init(0)
    arms.left.open()


def test_a_scheduler_that_does_not_start_or_does_not_call_is_one_sentence(arms: HdapiBench) -> None:
    arms.c.standin_refuse_start(0x0304)
    with pytest.raises(DeviceError, match="the scheduler of OpenHaptics does not start: HD_TIMER_ERROR"):
        arms.left.open()
    arms.left.close()
    arms.c.standin_refuse_start(0)
    arms.c.standin_stall(100_000)
    with pytest.raises(DeviceError, match="instrument 'left': the scheduler of OpenHaptics does not run"):
        arms.left.open()


def test_two_instruments_cannot_have_one_arm(arms: HdapiBench) -> None:
    arms.left.open()
    other = arms.driver("left")
    with pytest.raises(DeviceError, match=r"device 'Left' is another instrument's; `settings: {name: \.\.\.}` tells"):
        other.open()
    other.close()
    arms.run(300, LEFT, FREE)
    assert arms.left.calibrated


def test_the_file_of_a_stronger_device_is_refused(arms: HdapiBench) -> None:
    arms.c.standin_max_force(1, c_double(0.9))
    with pytest.raises(DeviceError, match=r"Stand-in 0001 can bear 0\.9 N, its device file says 3\.3 N"):
        arms.left.open()


@pytest.mark.parametrize(
    ("library", "reason"),
    [
        ("libHD-that-nobody-has.so", "OpenHaptics cannot be loaded: libHD-that-nobody-has.so: cannot open shared obj"),
        ("libm.so.6", "libm.so.6 is no HDAPI"),
    ],
)
def test_a_library_that_is_missing_or_another_is_one_sentence(library: str, reason: str) -> None:
    settings = DriverSettings(driver="phantom_hdapi", device="touch", settings={"library": library})
    arm = load_arm(settings, Place("left", Mount()))  # loads nothing
    with pytest.raises(DeviceError, match=f"instrument 'left': {reason}"):
        arm.open()
    arm.close()
