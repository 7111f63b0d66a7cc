"""The gripper of an omega.7 or sigma.7, through the device that its arm shares with it; see `dhd`."""

from __future__ import annotations

import numpy as np

from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.background_open import BackgroundOpen
from trocar.services.gateway.devices.device_files import GripperFile
from trocar.services.gateway.devices.driver import GraspHandle, HandleLimits, Place
from trocar.services.gateway.devices.limited_force import LimitedForce
from trocar.services.gateway.dhd.server import STALE_NS, DeviceServer, current_server, join_server, leave_server
from trocar.services.gateway.dhd.settings import DhdSettings
from trocar.services.gateway.servo.servo_arrays import HANDLE_ANGLE, HANDLE_RATE
from trocar.services.gateway.servo.velocity_filter import butterworth, low_pass
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config.rig import DriverSettings
from trocar.services.runtime.errors import DeviceError

#: Time of reads without an opening after which it is not used, and most that counts of the time from read to read, as
#: in a longer one this process was busy; how far an opening may be beyond the device file's widest, as a share.
_OLD_NS, _TURN_NS, _BEYOND = 200_000_000, 5_000_000, 1.25
#: Rate of a handle that takes turns with another, and how long a device may take until it tells its opening.
_PERIOD_S, _OPEN_S, _TURN_S = 2e-3, 2.0, 1e-3

_PART = "gripper"


class Driver(GraspHandle):
    """Its torque is a force at the fingers' distance from the axis.

    A gripper that bears none, as it is away for a moment or its motors are off, is given none, and is not ready: the
    law's torque begins anew, and what is given rises from none.
    """

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        self._own = driver.read_settings(DhdSettings, settings, place)
        self._file = file = driver.read_device_file(GripperFile, settings, place)
        self.max_torque_nm = file.max_force_n * file.lever_m
        self.limits = HandleLimits(*file.own(), file.interface_delay_s)
        self.where = f"instrument {place.instrument!r}"
        self._clock = place.clock
        self._server: DeviceServer | None = None
        self._opening: BackgroundOpen[DeviceServer] | None = None
        self._enabled = self._joined = False
        self._angle_rad, self._told_ns = 0.0, 0
        self._silent_ns = self._read_ns = 0
        self._filter, self._coefficients = np.zeros((2, 1)), butterworth(file.velocity_filter_hz, _PERIOD_S)
        self._rate = 0.0
        self._torque_rate_nm_s = place.torque_rate_nm_s
        self._torque = self._new_limiter()

    def open(self) -> None:
        """Open the device, unless its arm has it open, and wait for its opening."""
        self._server = server = self._join()
        until_ns = self._clock.monotonic_ns() + round(1e9 * _OPEN_S)
        while not self._take_sample(server) and self._clock.monotonic_ns() < until_ns:
            server.grip(0.0, self._clock.monotonic_ns())
            self._clock.sleep(_TURN_S)
        if not self._told_ns:
            why = "has no gripper" if not server.device.has_gripper else self._find_problem(server) or "is silent"
            raise DeviceError(f"{self.where}: the gripper's {server.model} {why}")

    def enable(self) -> None:
        """Let forces through."""
        self._enabled = self._server is not None
        if self._server is not None:
            self._server.switch_on()

    def clear_fault(self) -> None:
        """Open a device with a fault anew, unless its arm does."""
        had_fault = bool(self.fault)
        super().clear_fault()
        if had_fault and self._server is not None and self._opening is None:
            self._opening = BackgroundOpen(self._open_anew)

    def read(self, time_ns: int, handle: FloatArray) -> None:
        """Write the newest opening and its rate."""
        if self._server is None:
            return
        self._go_on()
        server = current_server(self._own.library, self._own.serial, self._server)
        if server is not self._server:
            self._server, self._torque = server, self._new_limiter()
        now_ns = self._clock.monotonic_ns()
        self._silent_ns = 0 if self._take_sample(server) else self._silent_ns + min(now_ns - self._read_ns, _TURN_NS)
        self._read_ns = now_ns
        handle[HANDLE_ANGLE], handle[HANDLE_RATE] = self._angle_rad, self._rate
        self._judge(server)

    def write(self, torque_nm: float) -> None:
        """Give a force to the fingers, unless the last order is not with the device yet."""
        server = self._server
        if server is None or self._opening is not None or server.grip_outstanding:
            return
        now_ns = self._clock.monotonic_ns()
        wanted_nm = torque_nm if self._enabled and not server.is_limp else 0.0
        (given_nm, _, _), _ = self._torque.next((wanted_nm, 0.0, 0.0), now_ns)
        force_n = given_nm / self._file.lever_m
        server.grip(force_n if self._file.opens_with_positive_force else -force_n, now_ns)

    def close(self) -> None:
        """Leave no force, and let the device go."""
        server, self._server = self._server, None
        self.ready = self._enabled = False
        if self._opening is not None:
            self._opening.take_opened()
            self._opening = None
        if server is not None:
            server.grip(0.0, self._clock.monotonic_ns())
        self._leave()

    def _new_limiter(self) -> LimitedForce:
        return LimitedForce(self._torque_rate_nm_s, STALE_NS)

    def _join(self) -> DeviceServer:
        own = self._own
        server = join_server(own.library, own.serial, own.gravity_compensation, _PART, self.where, self._clock)
        self._joined = True
        return server

    def _leave(self) -> None:
        if self._joined:
            leave_server(self._own.library, self._own.serial, _PART)
        self._joined = False

    def _open_anew(self) -> DeviceServer:
        self._leave()
        return self._join()

    def _go_on(self) -> None:
        if self._opening is None or not self._opening.done:
            return
        server, problem = self._opening.take_opened()
        self._opening = None
        if server is not None:
            self._server, self._silent_ns, self._torque = server, 0, self._new_limiter()
            if self._enabled:
                server.switch_on()
        else:
            self.fault = problem.removeprefix(f"{self.where}: ")

    def _take_sample(self, server: DeviceServer) -> bool:
        sample, now_ns = server.newest, server.newest_ns
        angle = None if sample is None or sample.problem else sample.angle_rad
        if angle is None or angle > _BEYOND * self._file.widest_rad or now_ns == self._told_ns:
            return False
        passed_s = max(1e-9 * (now_ns - self._told_ns), 1e-4)
        raw = (angle - self._angle_rad) / passed_s if self._told_ns else 0.0
        self._rate = low_pass(raw, self._filter, 0, self._coefficients)
        self._angle_rad, self._told_ns = angle, now_ns
        return True

    def _judge(self, server: DeviceServer) -> None:
        silent = self._silent_ns > _OLD_NS
        if silent:
            self._rate = 0.0
        opening = self._opening is not None
        self.prompt = "the gripper is being opened anew" if opening else ""
        if not opening and silent:
            problem = self._find_problem(server) or "tells no opening that a gripper can have"
            self.fault = self.fault or f"the gripper's {server.model} {problem}"
        is_away = opening or silent or server.is_limp or bool(self.fault)
        self.ready = self._enabled and server.device.gripper_pushes and not is_away

    def _find_problem(self, server: DeviceServer) -> str:
        return server.lost or ("" if server.newest is None else server.newest.problem)
