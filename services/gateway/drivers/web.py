"""An instrument in the hand of a person at the page: mouse, keyboard, gamepad or touch. Force is shown, not felt."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from protocol.bodies import Hands, HandTarget
from services.gateway import driver, pose, virtual_hand
from services.gateway.bench import Bench, no_output
from services.gateway.driver import Arm, ArmLimits, Place
from services.gateway.layout import MEMORY_FORCE, READ_ROLL
from services.gateway.virtual_hand import POSITION, STATE_SIZE, TICK_S
from services.mechanics.arrays import FloatArray
from services.runtime.errors import ConfigError
from services.runtime.rig import DriverSettings, Settings, Vector3

TOPIC = "visualization.hands"
#: The page speaks at 60 Hz at most; looking more often would cost the tick and find nothing.
LOOK_EVERY = 4
_ROLL_RAD_S = 6.0
_TICK_NS = 1_000_000
_MAX_TICKS = 20
_FROM_PORT_M = 0.01


class WebSettings(Settings):
    """Of the rig file: where the tool waits until somebody takes it, and how far it may be moved from there."""

    start_hip_m: Vector3 | None = Field(None, description="junction in the world; none: the middle of the workspace")
    start_roll_rad: float = 0.0
    reach_m: Annotated[float, Field(gt=0.0, le=0.3)] = Field(0.09, description="from the middle of the workspace")


class Driver(Arm):
    """Follows `visualization.hands` with a hand that yields to the tool's force; stays where it is when none speaks."""

    has_force = False
    limits = ArmLimits(max_force_n=3.0, continuous_force_n=3.0, max_damping_n_s_m=10.0, max_velocity_m_s=2.0)

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        self._settings = driver.read_settings(WebSettings, settings, place)
        self._place = place
        self._mount = pose.pack_mount(place.mount)
        self._centre = np.array(place.mount.centre_m)
        self._target = np.array(self._settings.start_hip_m or place.mount.centre_m)
        self._state = np.zeros(STATE_SIZE)
        self._force = np.zeros(3)
        self._roll = self._target_roll = self._settings.start_roll_rad
        self._last_ns = 0
        self._look = place.index
        self._check(place)

    def _check(self, place: Place) -> None:
        """Refuse a workspace with the port in it, where the shaft has no direction, and a start outside."""
        reach_m = self._settings.reach_m
        to_port_m = float(np.linalg.norm(self._centre - np.array(place.port_m)))
        where = f"instrument {place.instrument!r}, driver 'web'"
        if any(place.port_m) and to_port_m < reach_m + _FROM_PORT_M:
            raise ConfigError(f"{where}: reach_m: {reach_m} m from the middle reaches the port, {to_port_m:.3f} m away")
        if np.linalg.norm(self._target - self._centre) > reach_m:
            raise ConfigError(f"{where}: start_hip_m: is farther than reach_m from the middle of the workspace")

    def open(self) -> None:
        """Put the tool where it waits; a step of a copy makes the kernels ready."""
        virtual_hand.step_hand(self._state.copy(), self._target, self._force)
        virtual_hand.read_hand(self._state, self._mount, np.zeros(8))
        self._state[:] = 0.0
        self._state[POSITION : POSITION + 3] = self._target

    def enable(self) -> None:
        """Nothing to switch on."""

    def read(self, time_ns: int, reading: FloatArray) -> None:
        """Let the hand follow the page up to `time_ns`."""
        self._look += 1
        if self._look % LOOK_EVERY == 0:
            self._follow()
        ticks = round((time_ns - self._last_ns) / _TICK_NS) if self._last_ns else 0
        self._last_ns = time_ns
        for _ in range(min(ticks, _MAX_TICKS)):
            virtual_hand.step_hand(self._state, self._target, self._force)
            step = _ROLL_RAD_S * TICK_S
            self._roll += min(max(self._target_roll - self._roll, -step), step)
        virtual_hand.read_hand(self._state, self._mount, reading)
        reading[READ_ROLL] = self._roll

    def evaluate(
        self, model: FloatArray, motion: FloatArray, limits: FloatArray, now: FloatArray, memory: FloatArray
    ) -> None:
        """Compute the force as for any arm, and let the simulated hand yield to it."""
        super().evaluate(model, motion, limits, now, memory)
        self._force[:] = memory[MEMORY_FORCE : MEMORY_FORCE + 3]

    def write(self, force_n: FloatArray) -> None:
        """Ignore the force: `has_force` says so."""

    def close(self) -> None:
        """Leave no force."""
        self._force[:] = 0.0

    def _follow(self) -> None:
        hand = hand_of(self._place)
        if hand is not None:
            self._target = virtual_hand.within(np.array(hand.position_m), self._centre, self._settings.reach_m)
            self._target_roll = hand.roll_rad


def hand_of(place: Place) -> HandTarget | None:
    """Return where the page wants the instrument that is here, None if it does not say."""
    frame = place.newest(TOPIC)
    if frame is None or not frame.valid:
        return None
    body: Hands = frame.body
    return next((hand for hand in body.hands if hand.name == place.instrument), None)


@contextmanager
def bench(_folder: Path) -> Iterator[Bench]:
    """Nobody is at the page: the tool waits."""
    yield Bench(DriverSettings(driver="web"), output=no_output)
