from __future__ import annotations

import math

import pytest

from trocar.services.gateway.can import cansimple
from trocar.services.gateway.can.cansimple import AxisError, AxisState
from trocar.services.gateway.simulated import emulated_drive
from trocar.services.gateway.simulated.emulated_drive import EmulatedDrive, Handle

WATCHDOG_S, DT_S = 0.05, 1e-3


class Host:
    """A drive, its clock, and a host that may feed it."""

    def __init__(self) -> None:
        self.drive = EmulatedDrive(3, WATCHDOG_S, Handle(0.5))
        self.now_s = 10.0
        self.heard: list[tuple[int, bytes]] = []

    def send(self, command: int, data: bytes = b"", remote: bool = False) -> list[tuple[int, bytes]]:
        return self.drive.receive(cansimple.identifier(3, command), data, remote, self.now_s)

    def run(self, seconds: float, torque_nm: float | None = None, wanted_rad: float = 0.5) -> None:
        for _ in range(round(seconds / DT_S)):
            self.now_s += DT_S
            if torque_nm is not None:
                self.send(cansimple.SET_INPUT_TORQUE, cansimple.pack_float(torque_nm))
            self.heard += self.drive.step(wanted_rad, self.now_s, DT_S)

    def arm(self) -> None:
        self.send(cansimple.SET_CONTROLLER_MODE, cansimple.pack_words(1, 1))
        self.send(cansimple.SET_AXIS_STATE, cansimple.pack_word(AxisState.CLOSED_LOOP))

    def clear(self) -> None:
        self.send(cansimple.CLEAR_ERRORS, b"\0")


def test_torque_acts_in_closed_loop_only_and_moves_the_handle_by_its_stiffness() -> None:
    host = Host()
    host.run(0.5, torque_nm=0.1)
    assert host.drive.handle.angle_rad == pytest.approx(0.5)
    host.arm()
    host.run(1.0, torque_nm=0.1)
    expected = 0.5 + 0.1 / emulated_drive.HAND_STIFFNESS
    assert host.drive.handle.angle_rad == pytest.approx(expected, abs=1e-3)


def test_the_loop_closes_in_torque_mode_only() -> None:
    host = Host()
    host.send(cansimple.SET_AXIS_STATE, cansimple.pack_word(AxisState.CLOSED_LOOP))
    assert host.drive.state is AxisState.IDLE


def test_a_silent_host_is_let_go_by_the_watchdog_and_that_is_latched() -> None:
    host = Host()
    host.arm()
    host.run(0.1, torque_nm=0.1)
    assert host.drive.applied_nm == pytest.approx(0.1)
    host.run(WATCHDOG_S + 2 * DT_S)
    assert (host.drive.state, host.drive.applied_nm) == (AxisState.IDLE, 0.0)
    assert host.drive.errors == AxisError.WATCHDOG_TIMER_EXPIRED
    host.arm()
    host.run(0.1, torque_nm=0.1)
    assert host.drive.applied_nm == 0.0, "not before the error is cleared"
    host.clear()
    host.arm()
    host.run(0.1, torque_nm=0.1)
    assert host.drive.applied_nm == pytest.approx(0.1)


def test_any_frame_to_the_axis_feeds_the_watchdog_even_a_poll() -> None:
    host = Host()
    host.arm()
    for _ in range(10):
        host.run(0.5 * WATCHDOG_S)
        assert host.send(cansimple.GET_ENCODER_ESTIMATES, remote=True)
    assert host.drive.state is AxisState.CLOSED_LOOP


def test_a_frame_to_another_node_does_not_feed_it() -> None:
    host = Host()
    host.arm()
    for _ in range(10):
        host.run(0.5 * WATCHDOG_S)
        host.drive.receive(cansimple.identifier(4, cansimple.SET_INPUT_TORQUE), bytes(4), False, host.now_s)
    assert host.drive.state is AxisState.IDLE


def test_its_own_frames_given_back_by_the_bus_do_not_feed_it() -> None:
    host = Host()
    host.arm()
    for _ in range(100):
        host.run(DT_S)
        for identifier, data in host.heard:
            host.drive.receive(identifier, data, False, host.now_s)
    assert host.drive.errors == AxisError.WATCHDOG_TIMER_EXPIRED


def test_an_estop_is_latched() -> None:
    host = Host()
    host.arm()
    host.run(0.1, torque_nm=0.1)
    host.send(cansimple.ESTOP)
    host.run(0.1, torque_nm=0.1)
    assert host.drive.applied_nm == 0.0
    (_, data) = host.send(cansimple.GET_ERROR, remote=True)[0]
    assert cansimple.unpack_words(data) == (AxisError.ESTOP_REQUESTED, AxisError.ESTOP_REQUESTED)


def test_a_handle_faster_than_the_limit_is_let_go() -> None:
    host = Host()
    host.arm()
    host.send(cansimple.SET_LIMITS, cansimple.pack_floats(0.1, 10.0))
    host.run(0.05, torque_nm=0.0, wanted_rad=1.5)
    assert host.drive.errors & AxisError.VELOCITY_LIMIT


def test_estimates_come_every_other_millisecond_and_heartbeats_ten_times_a_second() -> None:
    host = Host()
    for _ in range(500):  # as the node does
        host.now_s += emulated_drive.ESTIMATE_S
        host.heard += host.drive.step(0.5, host.now_s, emulated_drive.ESTIMATE_S)
    kinds = [identifier & 0x1F for identifier, _ in host.heard]
    assert kinds.count(cansimple.GET_ENCODER_ESTIMATES) == 500
    assert 10 <= kinds.count(cansimple.HEARTBEAT) <= 11
    (_, data) = next(f for f in host.heard if f[0] & 0x1F == cansimple.GET_ENCODER_ESTIMATES)
    counts = cansimple.unpack_floats(data)[0] * emulated_drive.ENCODER_COUNTS
    assert counts == round(0.5 / (2 * math.pi) * emulated_drive.ENCODER_COUNTS)


@pytest.mark.parametrize("data", [b"", b"\0", bytes(3), bytes(9)])
def test_a_command_of_a_wrong_length_is_ignored(data: bytes) -> None:
    host = Host()
    for command in range(32):
        assert host.send(command, data) == []
    assert host.drive.torque_nm == 0.0
