"""A simulated Phantom Premium 1.5 in a scripted hand."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from trocar.protocol.topics import TICK_NS, TICK_S
from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.device_files import ArmFile
from trocar.services.gateway.devices.driver import Arm, Place
from trocar.services.gateway.hands.hand_arm import MAX_TICKS
from trocar.services.gateway.motions.script import ROLL, SCENE, Player, read_player
from trocar.services.gateway.servo import pose
from trocar.services.gateway.servo.servo_arrays import READ_ROLL, READ_SIZE
from trocar.services.gateway.simulated import premium_model, simulated_arm
from trocar.services.gateway.simulated.arm_tick import ArmTick, tick_arm
from trocar.services.gateway.simulated.simulated_arm import HAND_DAMPING, HAND_GRIP, HAND_STIFFNESS, HAND_TARGET
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config.bounds import Pace, Share, between
from trocar.services.runtime.config.rig import DriverSettings, Settings
from trocar.services.runtime.errors import ConfigError


class ArmSettings(Settings):
    """Settings in the rig file: the motion and stiffness of the hand on the simulated arm."""

    script: str | None = Field(
        None, description="a file of configs/scripts, or `scene`: what the scene is for; none: the hand holds still"
    )
    scenario: str | None = Field(None, description="instead of a script, a scenario of the mechanics")
    pace: Pace = Field(1.0, description="speed of the script; 0.5 takes twice as long")
    hand_stiffness_n_m: Annotated[float, between(0.0, 2000.0, "N/m", "no hand is stiffer")] = 300.0
    hand_damping_n_s_m: Annotated[float, between(0.0, 50.0, "N s/m", "no hand damps more")] = 5.0
    hand_grip_n: Annotated[float, between(0.0, 1000.0, "N", "no hand grips harder")] = 20.0
    tremor_m: Annotated[float, between(0.0, 2e-3, "m", "no hand that works trembles more")] = Field(
        0.0, description="amplitude of the scripted hand's tremor at 9 and 11 Hz; people's is 0.1 to 0.2 mm"
    )
    write_delay_s: Annotated[float, between(0.0, 5e-3, "s", "no interface of an arm takes longer")] = Field(
        0.0, description="longest time until a written force acts"
    )
    write_jitter: Share = Field(0.0, description="share of it by which forces are earlier, each by another one")
    true_friction: Share = Field(1.0, description="the arm's dry friction, as a share of the model's")


class Driver(Arm):
    """The arm of `simulated_arm`, whose hand starts its script when force is first switched on, or refused for long."""

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        self._settings = driver.read_settings(ArmSettings, settings, place)
        file = driver.read_device_file(ArmFile, settings, place)
        self.limits = file.limits()
        self.calibrated = False
        self._player = choose_player(self._settings, place)
        self._centre = premium_model.centre()
        self._stand = np.array([*pose.pack_mount(place.mount), *self._centre])
        self._force = np.zeros(3)
        self._reading = np.zeros(READ_SIZE)
        self._hand = np.zeros(simulated_arm.HAND_SIZE)
        self._hand[HAND_STIFFNESS] = self._settings.hand_stiffness_n_m
        self._hand[HAND_DAMPING] = self._settings.hand_damping_n_s_m
        self._hand[HAND_GRIP] = self._settings.hand_grip_n
        self._last_ns = 0
        self._script_s = 0.0
        self._running = False
        self._enabled = False
        self._move_hand()
        try:
            self._start = premium_model.inverse(self._hand[HAND_TARGET : HAND_TARGET + 3])
        except ValueError as error:
            raise ConfigError(f"instrument {place.instrument!r}: {error} to the script's first point") from None
        self.arm = simulated_arm.ArmState(self._start, file.velocity_filter_hz, self._settings.true_friction)
        self._random = np.random.default_rng(place.index)
        self._wait_s = self._settings.write_delay_s
        self._tick = None if self._player is None else self._tick_of(self._player)

    def _tick_of(self, player: Player) -> ArmTick:
        """Return the arguments of a tick's kernel: the arrays of this driver, its arm and its script."""
        arm = self.arm
        return ArmTick(
            times=player.times,
            values=player.values,
            value=player.value,
            rate=player.rate,
            port=player.port,
            beyond_m=player.beyond_m,
            tremor_m=self._settings.tremor_m,
            stand=self._stand,
            hand=self._hand,
            angles=arm.angles,
            rates=arm.rates,
            heat=arm.heat,
            force=self._force,
            writes=arm.writes,
            given=arm.given,
            work=arm.work,
            jacobian=arm.jacobian,
            measured=arm.measured,
            filter=arm.filter,
            coefficients=arm.coefficients,
            centre=self._centre,
            reading=self._reading,
            friction=arm.friction,
            wait_s=self._wait_s,
        )

    @property
    def force_n(self) -> FloatArray:
        """Force of the motors, in the frame of the arm."""
        return self._force

    def open(self) -> None:
        """Calibrate at once, and compile the kernels on copies."""
        simulated_arm.ArmState(self.arm.angles, 100.0).step(self._force, self._hand)
        self.arm.read(self._centre, self._reading)
        if self._player is not None:
            self._reading[READ_ROLL] = self._player.value[ROLL]
            copy = ArmTick.zeros(k=1, angles=self.arm.angles.copy())
            tick_arm(copy.address, 0.0, 0.0)
        self.calibrated = True

    def enable(self) -> None:
        """Switch the motors on, and start the script."""
        self._running = self._enabled = True

    def go_on(self) -> None:
        """Start the script without force."""
        self._running = True

    def begin_again(self) -> None:
        """Reset the arm to the script's start; the script starts with the force."""
        self._script_s = 0.0
        self._running = False
        self._move_hand()
        self.arm.put(self._start)

    def read(self, time_ns: int, reading: FloatArray) -> None:
        """Advance to `time_ns` and write the readings of encoders and motors."""
        ticks = round((time_ns - self._last_ns) / TICK_NS) if self._last_ns else 0
        self._last_ns = time_ns
        for _ in range(min(ticks, MAX_TICKS)):
            if self._running:
                self._script_s += TICK_S
            self._advance()
        reading[:] = self._reading

    def write(self, force_n: FloatArray) -> None:
        """Apply `force_n` until the next call, or none while the motors are off."""
        self._force[:] = force_n if self._enabled else 0.0
        settings = self._settings
        if settings.write_jitter > 0.0:
            self._wait_s = settings.write_delay_s * (1.0 - settings.write_jitter * self._random.random())
            if self._tick is not None:
                self._tick.wait_s = self._wait_s

    def write_span_ns(self, read_ns: int, written_ns: int) -> int:
        """Return how late the newest force acts in simulated time, whatever this host takes."""
        return round(1e9 * self._wait_s)

    def close(self) -> None:
        """Switch the motors off."""
        self._enabled = False
        self._force[:] = 0.0

    def _advance(self) -> None:
        """Take one tick and read the arm, whose velocity filter counts all ticks, lost ones included."""
        if self._tick is not None and self._player is not None:
            tick_arm(self._tick.address, self._player.within(self._script_s), self._script_s)
        else:
            self.arm.step(self._force, self._hand, self._wait_s)
            self.arm.read(self._centre, self._reading)

    def _move_hand(self) -> None:
        """Transform the script's target into the frame of the arm's base."""
        if self._player is None:
            self._hand[HAND_TARGET : HAND_TARGET + 3] = self._centre
            return
        self._player.sample(self._script_s)
        simulated_arm.place_hand(self._player.value, self._player.rate, self._stand, self._hand)


def choose_player(settings: ArmSettings, place: Place) -> Player | None:
    """Return the player that moves the hand of this instrument, None if it holds still."""
    if settings.scenario is not None:
        from trocar.services.gateway.motions.scenario_script import (
            scenario_player,  # only here: it imports the mechanics
        )

        return scenario_player(settings.scenario, place.index, place.port_m, settings.pace)
    if settings.script == SCENE:
        motion = place.motion
        return None if motion is None else Player(motion, False, place.port_m, settings.pace)
    if settings.script is not None:
        return read_player(settings.script, place.instrument, place.port_m, settings.pace)
    return None
