"""A handle on an ODrive: CANSimple over any interface of python-can."""

from __future__ import annotations

import contextlib
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Annotated, Any

import can
from pydantic import Field, field_validator

from trocar.services.gateway.can import can_checks, canbus, cansimple
from trocar.services.gateway.can.cansimple import AxisError, AxisState
from trocar.services.gateway.can.odrive_link import OdriveLink
from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.background_open import BackgroundOpen
from trocar.services.gateway.devices.device_files import GraspFile
from trocar.services.gateway.devices.driver import GraspHandle, HandleLimits, Place
from trocar.services.gateway.devices.host_check import HostCheck
from trocar.services.gateway.servo.servo_arrays import HANDLE_ANGLE, HANDLE_RATE
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import DriverSettings, Settings
from trocar.services.runtime.errors import DeviceError

#: A drive answers at once, and tells its state with a heartbeat, of which single ones may be late or lost.
_ARM_TIMEOUT_S = _VERSION_TIMEOUT_S = 5 * cansimple.HEARTBEAT_S
#: How far below zero a handle pressed shut may be, as a share of its largest angle.
_BELOW_SHUT = 0.25
#: Speeds beyond this multiple of the drive's own limit are none: it lets go at 1.2 times that.
_FASTEST = 2.0
#: Time without a late estimate until a handle is ready, in timeouts: one of a slow series is young for one of them.
_STEADY = 4.0


class OdriveSettings(Settings):
    """Settings in the rig file: bus and node."""

    bus: dict[str, Any] = Field(description="python-can's own settings: interface, channel, bitrate, ...")
    node: Annotated[int, Field(ge=0, le=cansimple.MAX_NODE)] = 1

    @field_validator("bus")
    @classmethod
    def _can_be_opened(cls, bus: dict[str, Any]) -> dict[str, Any]:
        canbus.check_keys(bus)
        if not canbus.bitrate(bus) > 0.0:
            raise ValueError(f"bitrate must be above 0 bit/s, is {bus['bitrate']!r}")
        return bus


class OdriveGrasp(GraspHandle, ABC):
    """Life cycle of the drive: it is found, set up, armed when force begins, fed every tick and released at the end.

    A disarm is latched in the drive. One by the watchdog (this gateway was delayed) ends with the next engagement; any
    other persists until a person has armed the rig. Arming also reopens the bus of a silent drive, because an adapter
    that was unplugged and is back is a new device to this host.
    """

    bitrate = canbus.DEFAULT_BITRATE
    #: Whether a silent bus may be reopened while the rig runs.
    reopens = False
    #: Drives send a heartbeat every 0.1 s.
    found_timeout_s = 3.0

    def __init__(self, file: GraspFile, node: int, place: Place) -> None:
        self.max_torque_nm = file.max_torque_nm
        self.limits = HandleLimits(*file.own(), file.interface_delay_s)
        self.file = file
        self.node = node
        self.where = f"instrument {place.instrument!r}"
        self._clock = place.clock
        self._link: OdriveLink | None = None
        sign = 1.0 if file.opens_with_positive_motor else -1.0
        self._rad_per_turn = sign * 2 * math.pi / file.motor_turns_per_handle_turn
        self._arming_until_ns = self._late_ns = self._steady_ns = 0  # late: newest tick of no young or likely estimate
        self._wanted = False
        self._opening: BackgroundOpen[can.BusABC] | None = None
        self._not_opened = ""
        self._impossible = ""  # what was said of estimates that no hand can make, until they are steady
        self._angle_rad = self._said_rad = 0.0  # the newest plausible angle, and the newest reported one

    @abstractmethod
    def open_bus(self) -> can.BusABC:
        """Open and return the drive's bus."""

    def open(self) -> None:
        """Find the drive and set it up, idle."""
        self._link = link = self._new_link(self.open_bus())
        if not self._find(link):
            noise = canbus.noise(link.bus)
            said = f"no heartbeat of node {self.node} within {self.found_timeout_s:g} s"
            raise DeviceError(f"{self.where}: {said}{'; ' if noise else ''}{noise}")
        problem = self._await_version(link)
        if problem:
            raise DeviceError(f"{self.where}: {problem}")
        self._set_up(link)

    def _await_version(self, link: OdriveLink) -> str:
        """Ask the drive for its firmware; return one sentence if it is not the needed one."""
        until_ns = self._clock.monotonic_ns() + round(_VERSION_TIMEOUT_S * 1e9)
        while not (link.firmware.is_needed or link.firmware.is_wrong) and self._clock.monotonic_ns() < until_ns:
            link.ask_version()
            self._clock.sleep(0.005)
            link.receive()
        return self._firmware_problem(link)

    def _firmware_problem(self, link: OdriveLink) -> str:
        problem = link.firmware.problem
        return f"{self._name} {problem}" if problem else ""

    def _new_link(self, bus: can.BusABC) -> OdriveLink:
        return OdriveLink(bus, self.node, self._clock, self.file.watchdog_s, self.bitrate)

    def _set_up(self, link: OdriveLink) -> None:
        """Send the settings that a drive loses without power: its limits, and torque control."""
        link.send(cansimple.CLEAR_ERRORS, b"\0")
        link.send(
            cansimple.SET_LIMITS, cansimple.pack_floats(self.file.max_motor_turns_s, self.file.max_motor_current_a)
        )
        mode = cansimple.pack_words(cansimple.CONTROL_TORQUE, cansimple.INPUT_PASSTHROUGH)
        link.send(cansimple.SET_CONTROLLER_MODE, mode)
        link.send_torque(0.0)

    def may_come(self) -> bool:
        """Return whether the drive may still appear."""
        return True

    def _find(self, link: OdriveLink) -> bool:
        until_ns = self._clock.monotonic_ns() + round(self.found_timeout_s * 1e9)
        while link.state is None and self.may_come() and self._clock.monotonic_ns() < until_ns:
            self._clock.sleep(0.005)
            link.receive()
        return link.state is not None

    def enable(self) -> None:
        """Close the loop, unless an error other than the watchdog's is latched."""
        link = self._link
        if link is None or not link.firmware.is_needed or link.errors & ~AxisError.WATCHDOG_TIMER_EXPIRED:
            return
        self._wanted = True
        if self._has_bus:
            self._arm(link)

    @property
    def is_opening(self) -> bool:
        """Whether its bus is being reopened; `read` then takes it over."""
        return self._opening is not None and not self._opening.done

    @property
    def _name(self) -> str:
        return f"the grasp drive (node {self.node})"

    def _bus_fault(self, error: can.CanError) -> str:
        return f"{self._name}: CAN: {error}"

    @property
    def _has_bus(self) -> bool:
        """Whether the link's bus is open and has not been replaced."""
        return self._opening is None and not self._not_opened

    def _arm(self, link: OdriveLink) -> None:
        try:
            self._set_up(link)
            link.send(cansimple.SET_AXIS_STATE, cansimple.pack_word(AxisState.CLOSED_LOOP))
        except can.CanError as error:
            self.fault = self._bus_fault(error)
        self._arming_until_ns = self._clock.monotonic_ns() + round(_ARM_TIMEOUT_S * 1e9)

    def clear_fault(self) -> None:
        """Clear errors latched in the drive, e-stop included, and search for a silent one, as the rig was armed."""
        super().clear_fault()
        link = self._link
        if link is None or self._opening is not None:
            return
        if self.reopens and (not self.may_come() or self._is_silent(link, self._clock.monotonic_ns())):
            self._opening = BackgroundOpen(partial(self._reopen, link.bus))
        elif self._wanted:
            self._arm(link)

    def _reopen(self, old: can.BusABC) -> can.BusABC:
        with contextlib.suppress(can.CanError, OSError):  # an unplugged adapter cannot even be closed
            old.shutdown()
        return self.open_bus()

    def _go_on(self, opening: BackgroundOpen[can.BusABC]) -> OdriveLink | None:
        """Return a link by the reopened bus, if there is one; the handle keeps its angle until the drive answers."""
        self._opening = None
        bus, problem = opening.take_opened()
        self._not_opened = problem.removeprefix(f"{self.where}: ")
        old = self._link
        if bus is None or old is None:
            return None
        self._link = link = self._new_link(bus)
        link.angle_turns = old.angle_turns
        self._arming_until_ns = self._clock.monotonic_ns() + round(self.found_timeout_s * 1e9)
        return link

    def read(self, time_ns: int, handle: FloatArray) -> None:
        """Write the newest estimates, and set `ready` if they are young and the loop is closed."""
        link = self._link
        if link is None:
            return
        if self._opening is not None and self._opening.done:
            link = self._go_on(self._opening) or link
        if self._has_bus:
            self._listen(link)
        self._said_rad = self._rad_per_turn * (link.angle_turns - self.file.shut_at_motor_turns)
        if self._is_possible:
            self._angle_rad = self._said_rad
        handle[HANDLE_ANGLE] = self._angle_rad
        handle[HANDLE_RATE] = self._rad_per_turn * link.rate_turns_s if self._is_possible else 0.0
        self._judge(link, self._clock.monotonic_ns())

    @property
    def _is_possible(self) -> bool:
        """Whether the newest estimates are plausible; angles are not if zero or gear differ from the device file."""
        link, file = self._link, self.file
        is_slow = link is not None and abs(link.rate_turns_s) <= _FASTEST * file.max_motor_turns_s
        return is_slow and -_BELOW_SHUT * file.widest_rad <= self._said_rad <= file.widest_rad

    def _listen(self, link: OdriveLink) -> None:
        """Receive frames; a drive that answers soon after its bus was reopened by a person is armed."""
        unknown = not link.firmware.is_needed
        if unknown and link.state is not None:
            self._ask_version(link)
        link.receive()
        is_soon = self._clock.monotonic_ns() < self._arming_until_ns
        if unknown and link.firmware.is_needed and self._wanted and is_soon:
            self._arm(link)

    def _ask_version(self, link: OdriveLink) -> None:
        try:
            link.ask_version()
        except can.CanError as error:
            self.fault = self._bus_fault(error)

    def _is_silent(self, link: OdriveLink, now_ns: int) -> bool:
        return now_ns - link.heartbeat_ns > self.file.heartbeat_timeout_s * 1e9

    def _silence(self) -> str:
        if self._opening is not None:
            return f"the bus of {self._name} is being opened anew"
        return self._not_opened or (f"{self._name} has been silent for {self.file.heartbeat_timeout_s} s")

    def _judge(self, link: OdriveLink, now_ns: int) -> None:
        timeout_ns = self.file.feedback_timeout_s * 1e9
        closed = link.state == AxisState.CLOSED_LOOP
        if not self._is_possible:
            self._impossible = (
                f"{self._name} says that its handle is at {self._said_rad:.3g} rad and turns at "
                f"{self._rad_per_turn * link.rate_turns_s:.3g} rad/s, which no hand can make: look at "
                "shut_at_motor_turns and motor_turns_per_handle_turn in its device file"
            )
            self._late_ns = now_ns
        elif now_ns - link.estimated_ns >= timeout_ns:
            self._late_ns = now_ns
        steady = now_ns - self._late_ns >= _STEADY * timeout_ns
        if steady:
            self._impossible = ""
        if steady or not (self._wanted and closed):
            self._steady_ns = now_ns
        if self._opening is not None or self._is_silent(link, now_ns):
            self.fault = self._silence()
        elif not link.firmware.is_needed:
            self.fault = self._firmware_problem(link)
        elif link.errors:
            self.fault = f"{self._name} let go: {cansimple.error_names(link.errors)}"
        elif self._impossible:
            self.fault = self._impossible
        elif self._wanted and not closed and now_ns > self._arming_until_ns:
            self.fault = f"{self._name} did not close its loop"
        elif now_ns - self._steady_ns > self.file.heartbeat_timeout_s * 1e9:
            self.fault = (
                f"{self._name} sends no position, or less often than every {1e3 * self.file.feedback_timeout_s:g} ms: "
                "set its encoder messages to 1 or 2 ms"
            )
        else:
            self.fault = ""
        self.ready = self._wanted and closed and steady and not self.fault

    def gauges(self) -> dict[str, float]:
        """Return the load of the bus, 0 to 1, by all frames seen on it."""
        return {"bus_load": self._link.load.share()} if self._link is not None else {}

    def write(self, torque_nm: float) -> None:
        """Send a torque, which also feeds the drive's watchdog."""
        if self._link is None or not self._has_bus:
            return
        turn_nm = torque_nm / self.file.motor_turns_per_handle_turn
        try:
            self._link.send_torque(turn_nm if self.file.opens_with_positive_motor else -turn_nm)
        except can.CanError as error:
            self.ready, self.fault = False, self._bus_fault(error)

    def close(self) -> None:
        """Set zero torque and idle state, and close the bus."""
        if self._opening is not None:
            self._go_on(self._opening)
        link, self._link = self._link, None
        self.ready = False
        if link is None or not self._has_bus:
            return
        try:
            link.send_torque(0.0)
            link.send(cansimple.SET_AXIS_STATE, cansimple.pack_word(AxisState.IDLE))
        except can.CanError as error:
            self.fault = self._bus_fault(error)  # the drive's watchdog disarms it
        finally:
            with contextlib.suppress(can.CanError):  # an unplugged adapter cannot even be closed
                link.bus.shutdown()


class Driver(OdriveGrasp):
    """The handle named in a rig file."""

    reopens = True

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        own = driver.read_settings(OdriveSettings, settings, place)
        super().__init__(driver.read_device_file(GraspFile, settings, place), own.node, place)
        self._bus_settings = own.bus
        self.bitrate = canbus.bitrate(own.bus)

    def open_bus(self) -> can.BusABC:
        """Return the bus named in the rig file."""
        return canbus.open_bus(self._bus_settings, self.where)


def check_host(settings: Sequence[DriverSettings], in_use: bool) -> Iterator[HostCheck]:
    """Check the buses, their settings, and the drives on them."""
    own = [config.build(OdriveSettings, each.settings, "driver 'grasp_odrive_can'") for each in settings]
    yield from can_checks.check([(each.bus, each.node) for each in own], in_use)
