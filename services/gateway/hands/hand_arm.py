"""An instrument in a virtual hand that follows a target and yields to contact. Force is displayed, not applied."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated

import numpy as np
from pydantic import Field

from trocar.protocol.topics import TICK_NS, TICK_S
from trocar.services.gateway.devices.driver import Arm, ArmLimits, Place
from trocar.services.gateway.hands import virtual_hand
from trocar.services.gateway.hands.virtual_hand import POSITION, STATE_SIZE
from trocar.services.gateway.servo import pose
from trocar.services.gateway.servo.servo_arrays import MEMORY_FORCE, READ_ROLL
from trocar.services.gateway.servo.slew import slew
from trocar.services.gateway.simulated import premium_model
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config.bounds import Turn, between
from trocar.services.runtime.config.rig import Settings, Vector3
from trocar.services.runtime.errors import ConfigError

#: Ticks between polls for a target, which arrives at 60 to 250 Hz.
LOOK_EVERY = 4
_ROLL_RAD_S = 6.0  # about a turn a second, so that a jump of what the page asks for is seen as a turn
#: Most ticks simulated at once: the arm of a process that was stopped resumes where it was. As many as a force model
#: lives.
MAX_TICKS = 20
_FROM_PORT_M = 0.01  # a shorter shaft turns too fast with the hand, by 100 rad/s at 1 m/s


class HandSettings(Settings):
    """Settings in the rig file: start of the tool, and its reach from there."""

    start_hip_m: Vector3 | None = Field(None, description="junction in the world; none: the middle of the workspace")
    start_roll_rad: Turn = 0.0
    reach_m: Annotated[
        float, between(1e-3, 0.3, "m", "no arm of a trainer reaches further, and a tool has to move")
    ] = Field(0.09, description="from the middle of the workspace")


class HandArm(Arm):
    """Follows a target with a hand that yields to the tool's force. Drivers set the target in `follow`.

    Attributes:
        target: ndarray (3,). Target of the junction, world, m; kept within reach.
        target_roll: float. Roll about the shaft, rad.
        felt_n: ndarray (3,). Force on the hand now, world, N.
    """

    has_force = False
    # It has neither encoders nor friction; those of a Premium make the force law behave as with one.
    limits = ArmLimits(
        max_force_n=3.0,
        continuous_force_n=3.0,
        max_velocity_m_s=2.0,
        count_m=premium_model.COUNT_M,
        friction_n=premium_model.FRICTION_N,
        delay_s=1e-4,
    )

    def __init__(self, name: str, settings: HandSettings, place: Place) -> None:
        self.place = place
        self._settings = settings
        self._mount = pose.pack_mount(place.mount)
        self._centre = np.array(place.mount.centre_m)
        self._start = np.array(settings.start_hip_m or place.mount.centre_m)
        self.target = self._start.copy()
        self._state = np.zeros(STATE_SIZE)
        self.felt_n = np.zeros(3)
        self._roll = self.target_roll = settings.start_roll_rad
        self._last_ns = 0
        self._waited = place.index
        self._passed_s = 0.0
        self._check(name, place)

    def _check(self, name: str, place: Place) -> None:
        """Reject a workspace that contains the port, where the shaft has no direction, and a start outside it."""
        reach_m = self._settings.reach_m
        to_port_m = float(np.linalg.norm(self._centre - np.array(place.port_m)))
        where = f"instrument {place.instrument!r}, driver {name!r}"
        if any(place.port_m) and to_port_m < reach_m + _FROM_PORT_M:
            raise ConfigError(f"{where}: reach_m: {reach_m} m from the middle reaches the port, {to_port_m:.3f} m away")
        if np.linalg.norm(self.target - self._centre) > reach_m:
            raise ConfigError(f"{where}: start_hip_m: is farther than reach_m from the middle of the workspace")

    def open(self) -> None:
        """Put the tool at its start, and compile the kernels on a copy."""
        virtual_hand.step_hand(self._state.copy(), self.target, self.felt_n)
        virtual_hand.read_hand(self._state, self._mount, np.zeros(8))
        slew(self._roll, self.target_roll, 0.0)
        self._put(self.target)

    def _put(self, place_m: FloatArray) -> None:
        self._state[:] = 0.0
        self._state[POSITION : POSITION + 3] = place_m

    def begin_again(self) -> None:
        """Put the tool, at rest, at its start."""
        self.target = self._start.copy()
        self._put(self.target)
        self._roll = self.target_roll = self._settings.start_roll_rad

    def enable(self) -> None:
        """Do nothing: there are no motors."""

    def read(self, time_ns: int, reading: FloatArray) -> None:
        """Advance the hand towards its target up to `time_ns`."""
        ticks = min(round((time_ns - self._last_ns) / TICK_NS), MAX_TICKS) if self._last_ns else 0
        self._last_ns = time_ns
        self._passed_s += ticks * TICK_S
        self._waited += 1
        if self._waited % LOOK_EVERY == 0:
            self.move_target(time_ns, self._passed_s)
            self.target = virtual_hand.within(self.target, self._centre, self._settings.reach_m)
            self._passed_s = 0.0
        for _ in range(ticks):
            virtual_hand.step_hand(self._state, self.target, self.felt_n)
            self._roll = slew(self._roll, self.target_roll, _ROLL_RAD_S * TICK_S)
        virtual_hand.read_hand(self._state, self._mount, reading)
        reading[READ_ROLL] = self._roll

    @abstractmethod
    def move_target(self, time_ns: int, passed_s: float) -> None:
        """Set `target` and `target_roll`, `passed_s` after the last call. Never waits."""

    def evaluate(
        self, model: FloatArray, motion: FloatArray, limits: FloatArray, now: FloatArray, memory: FloatArray
    ) -> None:
        """Compute the force as for any arm, and store it for the virtual hand."""
        super().evaluate(model, motion, limits, now, memory)
        self.felt_n[:] = memory[MEMORY_FORCE : MEMORY_FORCE + 3]

    def write(self, force_n: FloatArray) -> None:
        """Ignore the force, as `has_force` is false."""

    def close(self) -> None:
        """Set zero force."""
        self.felt_n[:] = 0.0
