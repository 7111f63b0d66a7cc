"""Interfaces of device drivers; `trocar.services.gateway.drivers` loads one by its name in the rig file.

A driver is a file in `trocar.services.gateway.drivers` with a class ``Driver`` derived from `Arm` or `GraspHandle`; it
may have a ``check_host`` (see `host_check`). There is no registry. Drivers never raise from `read` or `write`, but set
their `fault`.
"""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from trocar.protocol import Frame
from trocar.services.gateway.devices.clock import REAL_TIME, Clock
from trocar.services.gateway.motions.script import Motion
from trocar.services.gateway.servo.servo_law import servo_force
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import DriverSettings, Mount, Vector3
from trocar.services.runtime.errors import ConfigError

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ArmLimits:
    """Limits of an arm, and what the energy bound has to know of it.

    Attributes:
        count_m: Its resolution: an encoder's count, at the tip.
        friction_n: The friction that it surely has.
        delay_s: The longest time that its interface adds from a motion to the force that answers it.
    """

    max_force_n: float
    continuous_force_n: float
    max_velocity_m_s: float
    count_m: float
    friction_n: float
    delay_s: float = 0.0


@dataclass(frozen=True, slots=True)
class HandleLimits:
    """What the energy bound has to know of a handle.

    Attributes:
        count_rad: Its resolution.
        friction_nm: The friction that it surely has.
        sudden_rad: By how much more than in the last tick any hand may turn it in this.
        delay_s: The longest time that drive and bus add from a motion to the torque that answers it.
    """

    count_rad: float
    friction_nm: float
    sudden_rad: float
    delay_s: float


#: Of an instrument without a handle: nothing bounds the energy of its torque.
NO_HANDLE = HandleLimits(0.0, math.inf, 0.0, 0.0)


def _nothing(_topic: str) -> Frame | None:
    return None


@dataclass(frozen=True, slots=True)
class Place:
    """Context of a driver: instrument, mount of its arm, position of its trocar, and clock.

    `force_rate_n_s` and `torque_rate_nm_s` are the law's rate limits, for drivers that keep them themselves. `newest`
    returns the last frame of a topic that the gateway may read, for drivers whose device is another process. `motion`
    is the motion of the hand in the rig's scene, for simulated devices, if known.
    """

    instrument: str
    mount: Mount
    port_m: Vector3 = (0.0, 0.0, 0.0)
    index: int = 0
    clock: Clock = REAL_TIME
    force_rate_n_s: float = 200.0
    torque_rate_nm_s: float = 20.0
    newest: Callable[[str], Frame | None] = _nothing
    motion: Motion | None = None


class Device(ABC):
    """Base of arms and handles.

    Attributes:
        fault: str. Empty, or one sentence on why the device must not be used until a person has checked it.
        prompt: str. Empty, or one sentence on what a person has to do first, such as calibrating it.
        has_force: bool. False for a device that only measures.
    """

    fault: str = ""
    prompt: str = ""
    has_force: bool = True

    @abstractmethod
    def open(self) -> None:
        """Prepare the device for reading, with force off; may take seconds. `close` is called even after a failure.

        Raises DeviceError: one sentence, if it is missing.
        """

    @abstractmethod
    def enable(self) -> None:
        """Switch the motors on, as forces may follow. Returns at once."""

    def go_on(self) -> None:  # noqa: B027 - most devices have nothing to do
        """Called repeatedly while force cannot start because the demand at the hand's position is too large.

        A person who feels nothing moves on, or opens the jaws; a simulated hand does the same here.
        """

    def begin_again(self) -> None:  # noqa: B027 - a real hand is where it is
        """Reset a simulated hand to its start at once, as the scene restarts; no force is on."""

    def keep_pace(self, pace: float) -> None:  # noqa: B027 - most get their time by `read`
        """Set the pace, 0 to 1, of a simulated hand with a clock of its own."""

    def gauges(self) -> dict[str, float]:
        """Return figures for the dashboard, by name; called at most twenty times a second."""
        return {}

    def clear_fault(self) -> None:
        """Try again after a fault, as a person has armed the rig."""
        self.fault = ""

    @abstractmethod
    def close(self) -> None:
        """Set zero force and release the device. May be called twice, and without `open`."""


class Arm(Device):
    """A force-feedback arm. Its frame: z up, origin at the middle of its workspace.

    Attributes:
        calibrated: bool. Whether positions are valid; no force is written before.
        buttons: int. Bit mask.
        own_servo: bool. Whether the device has a thread of its own that evaluates and applies the force law; `evaluate`
            then passes the law's inputs on, and `write` is not called.
        skipped: int. How many forces in a row, up to the newest that was written, were not sent to the device, because
            what is between has not answered.
    """

    limits: ArmLimits
    calibrated: bool = True
    buttons: int = 0
    own_servo: bool = False
    skipped: int = 0

    def write_span_ns(self, read_ns: int, written_ns: int) -> int:
        """Return how long the newest force has taken from reading to writing.

        Args:
            read_ns, written_ns: When the gateway began to read the arm, and when it had written the force.
        """
        return written_ns - read_ns

    @abstractmethod
    def read(self, time_ns: int, reading: FloatArray) -> None:
        """Write position, velocity, temperature and roll into `reading`; see `servo_arrays`. Never waits.

        Values that the device does not measure (temperature, roll) are left unchanged.

        Args:
            time_ns: Time of the tick on the rig's grid, to which a simulated device advances.
        """

    def evaluate(
        self, model: FloatArray, motion: FloatArray, limits: FloatArray, now: FloatArray, memory: FloatArray
    ) -> None:
        """Compute the force of this tick, as `servo_law.servo_force` does. Never waits."""
        servo_force(model, motion, limits, now, memory)

    @abstractmethod
    def write(self, force_n: FloatArray) -> None:
        """Apply a force (3,) in the frame of the arm until the next call. Never waits.

        A driver's own `write` gets no other forces than those within the arm's limit: a larger one is shortened to it,
        and one that is not finite is none.
        """

    def __init_subclass__(cls) -> None:
        """Put the check of forces before the driver's own `write`."""
        if "write" in vars(cls):
            setattr(cls, "write", _within_force(cls.write))  # noqa: B010 - a method is replaced on purpose


class GraspHandle(Device):
    """A handle whose opening is measured and loaded with a torque.

    Attributes:
        ready: bool. Whether the drive is on and has answered lately; otherwise no torque is commanded.
    """

    max_torque_nm: float
    #: Those of a handle of 12 bits a turn, for devices that apply no torque.
    limits: HandleLimits = HandleLimits(count_rad=2e-3, friction_nm=2.5e-3, sudden_rad=0.02, delay_s=2.5e-3)
    ready: bool = False

    @abstractmethod
    def read(self, time_ns: int, handle: FloatArray) -> None:
        """Write angle and rate of the handle into `handle` (2,). Never waits."""

    @abstractmethod
    def write(self, torque_nm: float) -> None:
        """Apply a torque, positive opens, until the next call. Never waits.

        A driver's own `write` gets no other torques than those within the handle's limit: a larger one is cut to it,
        and one that is not finite is none.
        """

    def __init_subclass__(cls) -> None:
        """Put the check of torques before the driver's own `write`."""
        if "write" in vars(cls):
            setattr(cls, "write", _within_torque(cls.write))  # noqa: B010 - a method is replaced on purpose


def _within_force(write: Callable[[Any, FloatArray], None]) -> Callable[[Any, FloatArray], None]:
    @functools.wraps(write)
    def checked(self: Arm, force_n: FloatArray) -> None:
        size_n = math.hypot(*force_n.tolist())
        if not math.isfinite(size_n):
            force_n = np.zeros(3)
        elif size_n > self.limits.max_force_n:
            force_n = force_n * (self.limits.max_force_n / size_n)
        write(self, force_n)

    return checked


def _within_torque(write: Callable[[Any, float], None]) -> Callable[[Any, float], None]:
    @functools.wraps(write)
    def checked(self: GraspHandle, torque_nm: float) -> None:
        limit_nm = self.max_torque_nm
        write(self, min(max(torque_nm, -limit_nm), limit_nm) if math.isfinite(torque_nm) else 0.0)

    return checked


def read_settings(kind: type[T], settings: DriverSettings, place: Place) -> T:
    """Return the driver's settings of the rig file, checked."""
    return config.build(kind, settings.settings, f"instrument {place.instrument!r}, driver {settings.driver!r}")


def read_device_file(kind: type[T], settings: DriverSettings, place: Place) -> T:
    """Return the device file named in the rig file, checked.

    Raises ConfigError if none is named, or it is invalid.
    """
    if settings.device is None:
        raise ConfigError(f"instrument {place.instrument!r}: driver {settings.driver!r} needs a `device` file")
    return config.load(kind, config.find("device", settings.device))[0]
