"""Instruments steered by a gamepad or a SpaceMouse: which way, how quickly, and what happens when it goes away."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.gateway.hands import input_stand_in
from tests.gateway.hands.input_stand_in import InputStandIn
from trocar.protocol.bodies.haptics import MODEL_COLUMNS, MODEL_F0
from trocar.services.gateway import drivers
from trocar.services.gateway.devices.driver import Place
from trocar.services.gateway.hands import input_events, steering
from trocar.services.gateway.instruments.instrument import build_instruments
from trocar.services.gateway.servo import pose, servo_arrays
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import DriverSettings, Mount
from trocar.services.runtime.errors import ConfigError, DeviceError

TICK_NS = 1_000_000
RESTING = 300  # ticks in which nobody touches a device, after which it is known where it rests
MOUNT = Mount(centre_m=(0.065, -0.005, 0.02), yaw_rad=0.9)
PORT = (0.065, -0.085, 0.08)  # the shaft looks along +y and down: right is +x


class Hand:
    """An arm and a handle of one input, and their clock; with `rest`, nobody touches it in the first moment."""

    def __init__(self, kind: str, index: int = 0, rest: bool = True, **settings: Any) -> None:
        place = Place("left", MOUNT, PORT, index=index)
        self.arm = drivers.load_arm(DriverSettings(driver=kind, settings=settings), place)
        self.grasp = drivers.load_grasp(DriverSettings(driver=f"grasp_{kind}"), place)
        self.arm.open()
        self.grasp.open()
        self.now_ns = TICK_NS
        self.reading, self.handle = np.zeros(servo_arrays.READ_SIZE), np.zeros(servo_arrays.HANDLE_SIZE)
        self.motion = np.zeros(6)
        self.run(RESTING if rest else 0)

    def run(self, ticks: int, force_n: float = 0.0) -> np.ndarray:
        """Return where the junction is in the world after `ticks`, under a force along z."""
        model, limits = np.zeros(MODEL_COLUMNS), np.ones(servo_arrays.LIMIT_SIZE) * 1e3
        model[MODEL_F0 + 2] = force_n
        now, memory = np.zeros(servo_arrays.NOW_SIZE), np.zeros(servo_arrays.MEMORY_SIZE)
        now[servo_arrays.NOW_TTL], now[servo_arrays.NOW_GAIN], now[servo_arrays.NOW_DT] = 0.02, 1.0, 1e-3
        for _ in range(ticks):
            self.arm.read(self.now_ns, self.reading)
            self.grasp.read(self.now_ns, self.handle)
            pose.place_tool(self.reading, pose.pack_mount(MOUNT), np.array(PORT), self.motion, np.zeros(4))
            self.arm.evaluate(model, self.motion, limits, now, memory)
            self.now_ns += TICK_NS
        return self.motion[:3].copy()

    def close(self) -> None:
        self.arm.close()
        self.grasp.close()


@pytest.fixture
def pad() -> Iterator[InputStandIn]:
    source = input_stand_in.gamepad()
    with input_stand_in.only(source):
        yield source


def moved(hand: Hand, ticks: int = 100) -> np.ndarray:
    """Return how far the tool goes while the axes stay as they are, as right, up and inward."""
    before = hand.run(200)  # what began to move has its speed
    return steering.shaft_axes(before, np.array(PORT)) @ (hand.run(ticks) - before)


@pytest.mark.parametrize(
    ("index", "code", "value", "way"),
    [
        (0, "ABS_X", 32767, (1, 0, 0)),
        (0, "ABS_Y", 32767, (0, -1, 0)),
        (0, "ABS_HAT0Y", -1, (0, 0, 1)),
        (1, "ABS_RX", -32768, (-1, 0, 0)),
        (1, "BTN_SOUTH", 1, (0, 0, 1)),
        (1, "BTN_EAST", 1, (0, 0, -1)),
        (1, "ABS_X", 32767, (0, 0, 0)),
    ],
)
def test_a_held_axis_moves_its_own_tool_on_at_the_speed_of_the_rig_file(pad, index, code, value, way) -> None:
    hand = Hand("gamepad", index, speed_m_s=0.05)
    pad.say(code, value)
    np.testing.assert_allclose(moved(hand), 0.05 * 0.1 * np.array(way), atol=3e-4)  # the way turns as the tool goes
    hand.close()


def test_what_is_let_go_stays_and_what_hardly_moves_is_nothing(pad: InputStandIn) -> None:
    hand = Hand("gamepad")
    pad.say("ABS_X", 32767)
    hand.run(200)
    pad.say("ABS_X", 3000)
    place = hand.run(400)
    np.testing.assert_allclose(hand.run(400), place, atol=1e-6)
    hand.close()


def test_it_never_leaves_reach(pad: InputStandIn) -> None:
    hand = Hand("gamepad", reach_m=0.03, speed_m_s=0.5)
    pad.say("ABS_X", 32767)
    assert np.linalg.norm(hand.run(3000) - np.array(MOUNT.centre_m)) < 0.0301
    hand.close()


def test_jaws_close_as_far_as_the_trigger_is_pressed_and_wait_until_it_is_touched(pad: InputStandIn) -> None:
    hand = Hand("gamepad")
    hand.run(100)
    assert hand.handle[servo_arrays.HANDLE_ANGLE] == 1.0
    pad.say("ABS_Z", 255)
    hand.run(1500)
    assert hand.handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(0.0)
    pad.say("ABS_Z", 0)
    hand.run(1500)
    assert hand.handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(1.2)
    hand.close()


def test_what_a_hand_would_feel_shakes_the_gamepad(pad: InputStandIn) -> None:
    hand = Hand("gamepad")
    hand.run(300)
    assert pad.shaken == []
    hand.run(1000, force_n=1.0)
    assert 8 <= len(pad.shaken) <= 11, "ten times a second"
    assert set(pad.shaken) == {0xFFFF // 2}
    hand.close()


def test_an_unplugged_input_is_a_fault_the_tool_stays_and_arming_finds_it_again(pad: InputStandIn) -> None:
    hand = Hand("gamepad")
    pad.say("ABS_X", 32767)
    hand.run(200)
    pad.unplug()
    place = hand.run(500)
    np.testing.assert_allclose(hand.run(500), place, atol=1e-6)
    for device in (hand.arm, hand.grasp):
        assert device.fault == "Stand-in gamepad (/dev/input/event5) went away"
    anew = input_stand_in.gamepad()
    with input_stand_in.only(anew):
        for device in (hand.arm, hand.grasp):
            device.clear_fault()
            assert device.fault == ""
        hand.run(RESTING)
        anew.say("ABS_X", 32767)
        assert moved(hand)[0] > 0.004
        hand.close()
    assert anew.closed > 0
    assert not input_events._open


def test_the_grip_stays_as_it_is_while_the_input_is_away_and_after_it_is_back(pad: InputStandIn) -> None:
    """What was held would fall at the moment of the replug: a trigger that comes back says that it is not pressed."""
    hand = Hand("gamepad")
    pad.say("ABS_Z", 255)
    hand.run(1500)
    shut = hand.handle[servo_arrays.HANDLE_ANGLE]
    assert shut == pytest.approx(0.0)
    pad.unplug()
    hand.run(1500)
    assert hand.handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(shut)
    anew = input_stand_in.gamepad()
    with input_stand_in.only(anew):
        for device in (hand.arm, hand.grasp):
            device.clear_fault()
        hand.run(1500)
        assert hand.handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(shut), "nobody has touched the trigger yet"
        anew.say("ABS_Z", 100)
        hand.run(1500)
        assert hand.handle[servo_arrays.HANDLE_ANGLE] > 0.3
        hand.close()


def test_arming_while_it_is_still_away_says_so_and_raises_nothing() -> None:
    source = input_stand_in.gamepad()
    with input_stand_in.only(source):
        hand = Hand("gamepad")
    source.unplug()
    hand.run(20)
    hand.arm.clear_fault()
    assert "there is no gamepad in /dev/input" in hand.arm.fault
    hand.run(20)
    hand.close()


@pytest.mark.parametrize("absolute", [False, True])
def test_a_spacemouse_moves_the_tool_as_its_cap_is_pushed(absolute: bool) -> None:
    prefix = "ABS" if absolute else "REL"
    source = input_stand_in.spacemouse(absolute=absolute)
    with input_stand_in.only(source):
        hand = Hand("spacemouse")
        for _ in range(30):  # a relative axis repeats what it says while it is held
            source.say(f"{prefix}_Y", -350)
            hand.run(16)
        before = hand.motion[:3].copy()
        for _ in range(30):
            source.say(f"{prefix}_Y", -350)
            hand.run(16)
        way = steering.shaft_axes(before, np.array(PORT)) @ (hand.motion[:3] - before)
        np.testing.assert_allclose(way, [0.0, 0.0, 0.05 * 0.48], atol=1e-3)
        source.say(f"{prefix}_Y", 0)
        hand.run(400)
        place = hand.run(1)
        np.testing.assert_allclose(hand.run(200), place, atol=1e-6)
        source.say("BTN_0", 1)
        hand.run(1500)
        assert hand.handle[servo_arrays.HANDLE_ANGLE] == pytest.approx(0.0)
        hand.close()


def test_a_second_hand_needs_a_spacemouse_of_its_own_and_shares_a_gamepad(pad: InputStandIn) -> None:
    Hand("gamepad", index=1).close()
    with (
        input_stand_in.only(input_stand_in.spacemouse()),
        pytest.raises(DeviceError, match=r"instrument 'left': there are 1 of SpaceMouse and this is hand 2: plug"),
    ):
        Hand("spacemouse", index=1)


def test_without_any_input_it_is_one_sentence_and_so_is_an_axis_that_no_kernel_knows(pad: InputStandIn) -> None:
    with pytest.raises(DeviceError, match=r"instrument 'left': there is no SpaceMouse in /dev/input .*trocar doctor"):
        Hand("spacemouse")
    with pytest.raises(ConfigError, match=r"axes: 'ABS_COFFEE' is no axis or button"):
        Hand("gamepad", axes={"right": {"ABS_COFFEE": 1.0}})
    with pytest.raises(ConfigError, match=r"axes: there is no motion 'left'; known: right, up, inward, roll"):
        Hand("gamepad", axes={"left": {"ABS_X": 1.0}})


def test_axes_of_the_rig_file_replace_those_of_the_layout(pad: InputStandIn) -> None:
    hand = Hand("gamepad", axes={"right": {"ABS_RX": -1.0}})
    pad.say("ABS_RX", 32767)
    pad.say("ABS_X", 32767)
    assert moved(hand)[0] < -0.004
    hand.close()


@pytest.mark.parametrize("name", ["gamepad", "spacemouse"])
def test_the_rigs_differ_from_the_mouse_in_their_drivers_only(name: str) -> None:
    rig, mouse = config.load_rig(name), config.load_rig("mouse")
    assert [each.name for each in build_instruments(rig.gateway)] == ["left", "right"]
    for row, other in zip(rig.gateway.instruments, mouse.gateway.instruments, strict=True):
        assert (row.name, row.mount, row.port_m, row.arm.settings) == (
            other.name,
            other.mount,
            other.port_m,
            other.arm.settings,
        )


def test_what_the_kernel_dropped_is_asked_for_anew(pad: InputStandIn) -> None:
    """A stick was let go, and a button pressed, while nobody read: SYN_DROPPED, then the torn rest of a report."""
    inputs = input_events.open_inputs(input_events.GAMEPAD, None, 0, "here")
    for tick in range(RESTING):
        inputs.poll(tick * TICK_NS)
    pad.say("ABS_X", 32767)
    pad.say("BTN_SOUTH", 1)
    inputs.poll(RESTING * TICK_NS)
    assert (inputs.value("ABS_X"), inputs.value("BTN_SOUTH")) == (1.0, 1.0)
    pad.run_over("ABS_X", -32768, ["BTN_EAST"])
    inputs.poll((RESTING + 1) * TICK_NS)
    assert (inputs.value("ABS_X"), inputs.value("BTN_SOUTH"), inputs.value("BTN_EAST")) == (-1.0, 0.0, 1.0)
    pad.say("ABS_X", 0)
    inputs.poll((RESTING + 2) * TICK_NS)
    assert inputs.value("ABS_X") == pytest.approx(0.0, abs=1e-4)
    input_events.close_inputs(inputs)
