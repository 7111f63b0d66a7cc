"""An emulated ODrive axis with a handle: pure state, advanced by times and frames.

It models whatever a gateway could get wrong: the watchdog fed by any frame to the axis, its latched disarm, errors that
must be cleared before the loop closes again, the e-stop, torque that acts only in closed loop, and whole counts.
"""

from __future__ import annotations

import math
import struct

from trocar.services.gateway.can import cansimple
from trocar.services.gateway.can.cansimple import AxisError, AxisState

ESTIMATE_S = 0.002  # twice the period that is asked of drives (docs/how-to/hardware.md), as the slower case
FIRMWARE = (0, 6, 11)  # the firmware whose documentation was followed
#: Counts of the encoder a turn, as of the handle with which real grasps were recorded.
ENCODER_COUNTS = 8192
#: Handle with the fingers in it: inertia kg m2, stiffness N m/rad and damping N m s/rad of the hand, friction N m. The
#: damping is critical, 2 sqrt(k m); the rest are assumptions, as no fingers at a handle were measured.
INERTIA, HAND_STIFFNESS, HAND_DAMPING, FRICTION = 2e-5, 2.0, 0.0126, 0.005
_SUBSTEPS = 4  # of 0.5 ms: a sixth of the time in which the hand's spring turns by one radian, sqrt(m / k)
_TURN = math.tau
_SAID_BY_DRIVE = (
    cansimple.GET_VERSION,
    cansimple.HEARTBEAT,
    cansimple.GET_ERROR,
    cansimple.GET_ENCODER_ESTIMATES,
    cansimple.GET_TEMPERATURE,
    cansimple.GET_TORQUES,
)

CanFrame = tuple[int, bytes]


class Handle:
    """A handle between a hand that wants an angle and a motor that adds a torque."""

    def __init__(self, angle_rad: float) -> None:
        self.angle_rad = angle_rad
        self.rate_rad_s = 0.0

    def step(self, wanted_rad: float, torque_nm: float, dt_s: float) -> None:
        """Advance by `dt_s`: semi-implicit Euler, stable up to sub-steps of 6 ms with this hand."""
        h = dt_s / _SUBSTEPS
        for _ in range(_SUBSTEPS):
            hand = HAND_STIFFNESS * (wanted_rad - self.angle_rad) - HAND_DAMPING * self.rate_rad_s
            friction = FRICTION * math.tanh(20.0 * self.rate_rad_s)
            self.rate_rad_s += h * (hand + torque_nm - friction) / INERTIA
            self.angle_rad += h * self.rate_rad_s


class EmulatedDrive:
    """One axis: `receive` frames of the host, `step` time, take the frames to send from both.

    Args:
        node: CAN node number.
        watchdog_s: ``axis.config.watchdog_timeout``.
        handle: The handle on the motor; one motor turn is one handle turn.
    """

    def __init__(self, node: int, watchdog_s: float, handle: Handle) -> None:
        self.node = node
        self.handle = handle
        self.state = AxisState.IDLE
        self.errors = 0
        self.disarm_reason = 0
        self.torque_nm = 0.0
        self.armed_once = False
        self._torque_mode = False
        self._watchdog_s = watchdog_s
        self._fed_s = 0.0
        self._max_turns_s = math.inf
        self._next_heartbeat_s = 0.0

    @property
    def applied_nm(self) -> float:
        """Torque on the handle."""
        return self.torque_nm if self.state is AxisState.CLOSED_LOOP else 0.0

    def receive(self, identifier: int, data: bytes, remote: bool, now_s: float) -> list[CanFrame]:
        """Process a frame of the host and return the answers; frames of wrong node or length are ignored."""
        if identifier >> 5 != self.node:
            return []
        command = cansimple.command(identifier)
        if command in _SAID_BY_DRIVE and not remote:
            return []  # an own frame, echoed by the bus
        self._fed_s = now_s  # firmware feeds the watchdog from any frame to the axis, polls included
        if remote:
            return self._answer(command)
        try:
            self._obey(command, data, now_s)
        except struct.error:
            return []
        return []

    def step(self, wanted_rad: float, now_s: float, dt_s: float) -> list[CanFrame]:
        """Advance the handle by `dt_s`, check watchdog and limits, and return the cyclic frames that are due."""
        self.handle.step(wanted_rad, self.applied_nm, dt_s)
        if self.state is AxisState.CLOSED_LOOP:
            if now_s - self._fed_s > self._watchdog_s:
                self._disarm(AxisError.WATCHDOG_TIMER_EXPIRED)
            elif abs(self.handle.rate_rad_s) / _TURN > self._max_turns_s:
                self._disarm(AxisError.VELOCITY_LIMIT)
        frames = self._answer(cansimple.GET_ENCODER_ESTIMATES)
        if now_s >= self._next_heartbeat_s:
            self._next_heartbeat_s = now_s + cansimple.HEARTBEAT_S
            frames += self._answer(cansimple.HEARTBEAT)
        return frames

    def _answer(self, command: int) -> list[CanFrame]:
        if command == cansimple.GET_ENCODER_ESTIMATES:
            turns = round(self.handle.angle_rad / _TURN * ENCODER_COUNTS) / ENCODER_COUNTS
            data = cansimple.pack_floats(turns, self.handle.rate_rad_s / _TURN)
        elif command == cansimple.HEARTBEAT:
            data = cansimple.pack_heartbeat(self.errors, self.state, 0, False)
        elif command == cansimple.GET_VERSION:
            data = cansimple.pack_version(*FIRMWARE)
        elif command == cansimple.GET_ERROR:
            data = cansimple.pack_words(self.errors, self.disarm_reason)
        elif command == cansimple.GET_TORQUES:
            data = cansimple.pack_floats(self.torque_nm, self.applied_nm)
        else:
            return []
        return [(cansimple.identifier(self.node, command), data)]

    def _obey(self, command: int, data: bytes, now_s: float) -> None:
        if command == cansimple.SET_INPUT_TORQUE:
            self.torque_nm = cansimple.unpack_float(data)
        elif command == cansimple.SET_AXIS_STATE:
            self._change_state(cansimple.unpack_words(data)[0], now_s)
        elif command == cansimple.SET_CONTROLLER_MODE:
            mode = cansimple.unpack_words(data)
            self._torque_mode = mode == (cansimple.CONTROL_TORQUE, cansimple.INPUT_PASSTHROUGH)
        elif command == cansimple.SET_LIMITS:
            self._max_turns_s = cansimple.unpack_floats(data)[0]
        elif command == cansimple.CLEAR_ERRORS:
            self.errors = 0
        elif command == cansimple.ESTOP:
            self._disarm(AxisError.ESTOP_REQUESTED)

    def _change_state(self, state: int, now_s: float) -> None:
        if state == AxisState.IDLE:
            self.state = AxisState.IDLE
        elif state == AxisState.CLOSED_LOOP and self._torque_mode and not self.errors:
            self.state = AxisState.CLOSED_LOOP
            self.armed_once = True
            self._fed_s = now_s

    def _disarm(self, error: AxisError) -> None:
        self.errors |= error
        self.disarm_reason = int(error)
        self.state = AxisState.IDLE
        self.torque_nm = 0.0
