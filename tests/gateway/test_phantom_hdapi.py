"""The driver against a stand-in of the library, in the stand-in's own time: exact to the tick."""

from __future__ import annotations

from collections.abc import Iterator
from ctypes import c_double
from pathlib import Path

import numpy as np
import pytest

from services.gateway import layout
from services.gateway.bench import BenchUnavailable
from services.gateway.driver import Place, load_arm
from services.gateway.engagement import SMALL_FORCE_N
from services.gateway.hdapi.constants import ERRORS, Style
from services.gateway.hdapi.library import Library
from services.runtime.errors import DeviceError
from services.runtime.rig import DriverSettings, Mount
from tests.gateway.hdapi_bench import RATE_N_S, TTL_MS, HdapiBench, two_arms

FREE = (0.0, 0.0, 0.0)
LEFT, RIGHT = (0.3, -0.2, 2.0), (0.0, 1.0, 0.0)
#: A step at the rate limit, and what rounding adds.
STEP_N = RATE_N_S * 1e-3 + 1e-12
REFUSALS, SCHEDULER, WARM = (0x0201, 0x0202, 0x0203, 0x0204), (0x0304, 0x0500, 0x0501), 0x0200
UNKNOWN = 0x0777
LATCHED = [*sorted(set(ERRORS) - {*REFUSALS, *SCHEDULER, WARM}), UNKNOWN]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[HdapiBench]:
    try:
        with two_arms(tmp_path) as arms:
            yield arms
    except BenchUnavailable as reason:
        pytest.skip(str(reason))


@pytest.fixture(params=["force", "law"])
def pushing(bench: HdapiBench, request: pytest.FixtureRequest) -> HdapiBench:
    """Return both arms under the full force that was asked for: ordered as it is, or as a law."""
    bench.by_law = request.param == "law"
    bench.open()
    bench.begin(LEFT, RIGHT)
    np.testing.assert_allclose(bench.forces[-1], [LEFT, RIGHT])
    return bench


def test_axes_and_units(bench: HdapiBench) -> None:
    bench.open()
    bench.standin.put("place", 1, np.array([0.01, 0.02, 0.03]))  # right, up, toward the user
    bench.run(2, FREE, FREE)
    reading = bench.readings[bench.left]
    np.testing.assert_allclose(reading[:3], [0.03, 0.01, 0.02])  # toward the user, right, up
    bench.begin((0.0, 0.0, 0.5), FREE)
    np.testing.assert_allclose(bench.standin.look(1).force_n, [0.0, 0.5, 0.0])
    assert bench.readings[bench.left][2] > 0.0201, "a force upward lifts the hand"


def test_the_middle_of_a_premiums_workspace_is_where_its_device_file_says(tmp_path: Path) -> None:
    with two_arms(tmp_path, "phantom_premium_1_5") as bench:
        bench.open()
        bench.standin.put("place", 1, np.array([0.0, 0.1, 0.0]))
        bench.run(2, FREE, FREE)
        np.testing.assert_allclose(bench.readings[bench.left][:3], 0.0, atol=1e-12)


def test_velocity_is_that_of_the_hand(bench: HdapiBench) -> None:
    bench.open()
    for k in range(200):
        bench.standin.put("hand", 1, np.array([0.0, 2e-4 * k, 0.0]))  # 0.2 m/s upward
        bench.run(1, FREE, FREE)
    assert bench.readings[bench.left][layout.READ_VELOCITY + 2] == pytest.approx(0.2, rel=0.02)
    np.testing.assert_allclose(bench.readings[bench.left][[3, 4]], 0.0, atol=1e-9)


def test_two_arms_are_served_by_one_callback_and_get_each_their_own(pushing: HdapiBench) -> None:
    frames = [pushing.standin.look(device).frames for device in (1, 2)]
    pushing.run(50, LEFT, RIGHT)
    assert [pushing.standin.look(device).frames for device in (1, 2)] == [frames[0] + 50, frames[1] + 50]
    assert pushing.standin.look(0).frames == 0
    assert pushing.largest_step_n() <= STEP_N
    assert pushing.left.fault == pushing.right.fault == ""


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
    pushing.run(40, LEFT, RIGHT)
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


@pytest.mark.parametrize("share", [0.85, 1.15])
@pytest.mark.parametrize(("by_law", "delay_ticks"), [(False, 1.0), (True, 0.0)])
def test_a_wall_is_as_stiff_as_its_delay_allows(
    bench: HdapiBench, by_law: bool, delay_ticks: float, share: float
) -> None:
    """K < b / (T / 2 + delay): a law has none, a force is one tick old; docs/decisions/hdapi-callback.md."""
    damping_n_s_m, tick_s = 5.1, 1e-3  # of hand and arm, in arm.c
    wall_n_m = share * damping_n_s_m / ((0.5 + delay_ticks) * tick_s)
    bench.by_law = by_law
    bench.open()
    bench.run(300, FREE, FREE)
    bench.standin.put("place", 1, np.array([0.0, 1e-5, 0.0]))
    heights, reading = [], bench.readings[bench.left]
    for _ in range(600):
        bench.left.read(0, reading)
        bench.order(bench.left, np.array([0.0, 0.0, -wall_n_m * reading[2] * (not by_law)]), wall_n_m)
        bench.wait(1)
        heights.append(bench.standin.look(1).position_m[1])
    early, late = np.ptp(heights[50:150]), np.ptp(heights[500:])
    assert (late < 0.5 * early) == (share < 1.0)
    assert (late > 2.0 * early) == (share > 1.0)


def test_a_law_is_evaluated_in_the_world_at_the_present_pose(tmp_path: Path) -> None:
    """The arm is turned by 90 degrees and moved: toward its user is the world's y."""
    with two_arms(tmp_path) as bench:
        bench.by_law = True
        bench.left = bench.driver("left", Mount(centre_m=(0.1, 0.2, 0.3), yaw_rad=np.pi / 2))
        bench.readings = {bench.left: np.zeros(layout.READ_SIZE)}
        bench.memories = {bench.left: np.zeros(layout.MEMORY_SIZE)}
        bench.open()
        for _ in range(300):
            bench.standin.put("place", 1, np.array([0.0, 0.0, 0.01]))  # of HDAPI: toward the user
            bench.left.read(0, bench.readings[bench.left])
            bench.order(bench.left, np.zeros(3), stiffness_n_m=0.5)
            bench.wait(1)
        memory = bench.memories[bench.left]
        world_m, force_n = memory[layout.MEMORY_POSITION :][:3], memory[layout.MEMORY_FORCE :][:3]
        np.testing.assert_allclose(world_m, [0.1, 0.21, 0.3], atol=1e-4)  # the force moves it within the tick
        np.testing.assert_allclose(force_n, -0.5 * world_m)
        np.testing.assert_allclose(bench.forces[-1][0], [-0.105, 0.05, -0.15], atol=1e-4)


@pytest.mark.parametrize("code", [*REFUSALS, WARM, *LATCHED], ids=hex)
def test_no_error_makes_an_arm_give_more_than_it_was_given(bench: HdapiBench, code: int) -> None:
    """A hand presses into a spring and comes back, again and again, while force is refused and comes back.

    It may come back where less than SMALL_FORCE_N is asked for: with what a spring that is held so holds, no more.
    """
    stiffness_n_m = 400.0
    bench.by_law, bench.damping_n_s_m = True, 5.0
    bench.open()
    bench.run(300, FREE, FREE)
    taken_j, returns, last_m = 0.0, 0, bench.standin.look(1).position_m
    for k in range(2000):
        bench.standin.put("hand", 1, np.array([0.0, -0.006 * np.sin(4 * np.pi * 1e-3 * k) ** 2, 0.0]))
        if k % 137 == 0:
            bench.c.standin_inject(1, code)
            returns += code != WARM
        if k % 411 == 300:
            bench.left.clear_fault()
        bench.left.read(0, bench.readings[bench.left])
        bench.order(bench.left, np.zeros(3), stiffness_n_m)
        force_n = bench.standin.look(1).force_n
        bench.wait(1)
        position_m = bench.standin.look(1).position_m
        taken_j += force_n @ (position_m - last_m)
        last_m = position_m
    assert taken_j < 1e-4 + returns * 0.5 * SMALL_FORCE_N**2 / stiffness_n_m
    assert bench.largest_step_n() <= STEP_N


def test_what_the_law_refuses_is_counted_with_what_the_torque_refuses(bench: HdapiBench) -> None:
    bench.by_law = True
    bench.open()
    memory = bench.memories[bench.left]
    memory[layout.MEMORY_REFUSED] += 5.0  # by the torque's law, in the gateway
    memory[layout.MEMORY_TORQUE] = 0.1
    bench.run(10, (0.0, np.nan, 0.0), RIGHT)
    bench.run(3, LEFT, RIGHT)
    assert memory[layout.MEMORY_REFUSED] == 15.0
    assert memory[layout.MEMORY_TORQUE] == 0.1


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


def test_motor_temperature_is_that_of_the_warmest_motor(pushing: HdapiBench) -> None:
    pushing.c.standin_heat(1, c_double(0.8))
    pushing.run(2, LEFT, RIGHT)
    assert pushing.readings[pushing.left][layout.READ_TEMPERATURE] == pytest.approx(0.8, rel=1e-3)
    pushing.c.standin_inject_every(1, WARM)
    pushing.run(3, LEFT, RIGHT)
    assert pushing.readings[pushing.left][layout.READ_TEMPERATURE] == 1.0
    assert pushing.left.fault == ""


def test_roll_counts_as_the_rigs_does_where_the_arm_measures_it(bench: HdapiBench) -> None:
    bench.c.standin_lack(2, 0x2150)
    bench.open()
    for reading in bench.readings.values():
        reading[layout.READ_ROLL] = 0.7
    bench.run(2, FREE, FREE)
    assert bench.readings[bench.left][layout.READ_ROLL] == -0.25  # clockwise is against the rig's roll
    assert bench.readings[bench.right][layout.READ_ROLL] == 0.7


def test_an_arm_that_knows_no_temperature_works(bench: HdapiBench) -> None:
    bench.c.standin_lack(1, 0x2605)
    bench.open()
    bench.begin(LEFT, RIGHT)
    np.testing.assert_allclose(bench.forces[-1], [LEFT, RIGHT])
    assert bench.left.fault == ""


def test_no_force_before_calibration_and_a_person_is_told_about_the_inkwell(bench: HdapiBench) -> None:
    bench.c.standin_style(1, int(Style.INKWELL))
    bench.open()
    bench.begin(LEFT, RIGHT)
    assert not bench.left.calibrated
    assert bench.left.prompt == "the arm 'Left': put the stylus into its inkwell: the arm is not calibrated"
    np.testing.assert_allclose(bench.forces[-1], [FREE, RIGHT])
    bench.c.standin_inkwell(1, 1)
    bench.begin(LEFT, RIGHT)
    assert bench.left.calibrated
    assert bench.left.prompt == bench.left.fault == ""
    np.testing.assert_allclose(bench.forces[-1], [LEFT, RIGHT])


@pytest.mark.parametrize("by_button", [True, False])
def test_encoders_are_reset_only_when_a_person_says_so(bench: HdapiBench, by_button: bool) -> None:
    bench.c.standin_style(1, int(Style.ENCODER_RESET))
    bench.open()
    bench.run(500, LEFT, RIGHT)
    assert bench.standin.look(1).calibrations == 0
    assert "hold the arm in its reset posture" in bench.left.prompt
    if by_button:
        bench.c.standin_buttons(1, 1)
    else:
        bench.left.clear_fault()
    bench.begin(LEFT, RIGHT)
    assert bench.standin.look(1).calibrations == 1
    np.testing.assert_allclose(bench.forces[-1], [LEFT, RIGHT])
    assert bench.left.buttons == int(by_button)


def test_a_lost_calibration_is_a_fault(pushing: HdapiBench) -> None:
    pushing.c.standin_style(1, int(Style.INKWELL))  # which it cannot find again by itself
    pushing.c.standin_uncalibrate(1)
    pushing.run(1100, LEFT, RIGHT)
    assert "the arm 'Left' has lost its calibration" in pushing.left.fault
    np.testing.assert_array_equal(pushing.forces[-1], [FREE, RIGHT])


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
def test_a_device_that_cannot_be_opened_is_one_sentence(bench: HdapiBench, code: int) -> None:
    bench.c.standin_refuse_init(code)
    with pytest.raises(DeviceError, match=f"instrument 'left': device 'Left' cannot be opened: {ERRORS[code][0]}"):
        bench.open()


def test_a_scheduler_that_does_not_start_or_does_not_call_is_one_sentence(bench: HdapiBench) -> None:
    bench.c.standin_refuse_start(0x0304)
    with pytest.raises(DeviceError, match="the scheduler of OpenHaptics does not start: HD_TIMER_ERROR"):
        bench.left.open()
    bench.left.close()
    bench.c.standin_refuse_start(0)
    bench.c.standin_stall(100_000)
    with pytest.raises(DeviceError, match="instrument 'left': the scheduler of OpenHaptics does not run"):
        bench.left.open()


def test_two_instruments_cannot_have_one_arm(bench: HdapiBench) -> None:
    bench.left.open()
    other = bench.driver("left")
    with pytest.raises(DeviceError, match=r"device 'Left' is another instrument's; `settings: {name: \.\.\.}` tells"):
        other.open()
    other.close()
    bench.run(300, LEFT, FREE)
    assert bench.left.calibrated


def test_the_file_of_a_stronger_device_is_refused(bench: HdapiBench) -> None:
    bench.c.standin_max_force(1, c_double(0.9))
    with pytest.raises(DeviceError, match=r"Stand-in 0001 can bear 0\.9 N, its device file says 3\.3 N"):
        bench.left.open()


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
