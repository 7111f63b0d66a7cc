"""A Phantom or Touch arm through the vendor's OpenHaptics."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from pydantic import Field

from trocar.protocol.bodies.haptics import MODEL_COLUMNS
from trocar.services.gateway.devices import driver
from trocar.services.gateway.devices.asked_arm import CLOSE_S
from trocar.services.gateway.devices.device_files import ArmFile
from trocar.services.gateway.devices.driver import Arm, Place
from trocar.services.gateway.devices.host_check import HostCheck
from trocar.services.gateway.devices.vendor_library import RAISE_EVERY
from trocar.services.gateway.hdapi import cells, exchange, host_checks, session
from trocar.services.gateway.hdapi.constants import Calibration, Style, describe
from trocar.services.gateway.hdapi.error_stack import unreachable
from trocar.services.gateway.hdapi.library import DEFAULT
from trocar.services.gateway.hdapi.open_arm import ArmTerms, OpenArm
from trocar.services.gateway.hdapi.reopening import Reopening
from trocar.services.gateway.servo.engagement import SMALL_FORCE_N
from trocar.services.gateway.servo.servo_arrays import (
    LIMIT_SIZE,
    MEMORY_DEMAND,
    MEMORY_SIZE,
    NOW_SIZE,
    NOW_TTL,
    READ_SIZE,
    READ_TEMPERATURE,
)
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config import config
from trocar.services.runtime.config.rig import DriverSettings, Settings
from trocar.services.runtime.errors import DeviceError

#: How long a started scheduler may take until its first call, and a released arm until it is free of force.
_START_S, _LET_GO_S = 1.0, CLOSE_S
#: Reads in a row (ms of this process) that may find no new state of the arm: as long as a force model lives at most.
_SILENT_READS = 20
#: Frames in a row that may refuse force; a person who moves too fast for a moment is no fault.
_REFUSED_FRAMES = 200
_PROMPTS = {
    Style.AUTO: "move the arm a little until it has calibrated itself",
    Style.INKWELL: "put the stylus into its inkwell: the arm is not calibrated",
    Style.ENCODER_RESET: "hold the arm in its reset posture and press its button, or arm the rig, to calibrate it",
}


class HdapiSettings(Settings):
    """Settings in the rig file: the arm."""

    name: str | None = Field(None, description="name of the device in the vendor's set-up; none: its default device")
    library: str = Field(DEFAULT, description="OpenHaptics' HDAPI: a name that the loader finds, or a path")


class Driver(Arm):
    """One arm of the scheduler that all arms of this process share, and whose thread evaluates the law; see `hdapi`."""

    own_servo = True

    def __init__(self, settings: DriverSettings, place: Place) -> None:
        own = driver.read_settings(HdapiSettings, settings, place)
        file = driver.read_device_file(ArmFile, settings, place)
        self.limits = file.limits()
        self.calibrated = False
        self._name, self._path = own.name, own.library
        self._shown = "the arm" if own.name is None else f"the arm {own.name!r}"
        self._where = f"instrument {place.instrument!r}"
        self._clock = place.clock
        self._terms = ArmTerms(
            file.max_force_n,
            place.force_rate_n_s,
            file.velocity_filter_hz,
            file.openhaptics_centre_m,
            place.mount,
            file.interface_delay_s,
        )
        self._session: session.Session | None = None
        self._arm: OpenArm | None = None
        self._enabled = False
        self._armed = 0
        self._reads = 0
        self._silent = 0
        self._unsettled = True  # the state must be judged even without a new message
        self._wants_reopening = False
        self._reopening: Reopening | None = None
        self._read_at = 0.0
        self._was_calibrated = False
        self._no_force = np.zeros(3)
        self._reading = np.zeros(READ_SIZE)

    @property
    def arm(self) -> OpenArm | None:
        """The open arm; None while it is not open."""
        return self._arm

    def open(self) -> None:
        """Load the library, open the device, and wait for its first frame."""
        opened = session.find_session(self._path, self._clock, self._where)
        arm = opened.join(self._name, self._terms, self._where)
        self._session, self._arm = opened, arm
        if problem := self._weakness(arm):
            raise DeviceError(f"{self._where}: {problem}")
        if not self._wait(arm, _START_S, lambda seen: seen[cells.SEEN_TIME] > 0.0):
            why = self._problem(arm.port.newest.tolist()) or "the scheduler of OpenHaptics does not run"
            raise DeviceError(f"{self._where}: {why}")
        self._silent = 0
        self._warm()

    def _weakness(self, arm: OpenArm) -> str:
        if arm.nominal_max_force_n >= self.limits.max_force_n:
            return ""
        return (
            f"{arm.model} can bear {arm.nominal_max_force_n:g} N, its device file says "
            f"{self.limits.max_force_n:g} N: name the file of this arm as `device`"
        )

    @property
    def is_reopening(self) -> bool:
        """Whether the arm is being reopened, or will be."""
        return self._wants_reopening or self._reopening is not None

    def gauges(self) -> dict[str, float]:
        """Return what was measured of the library's callback.

        Its rate in Hz, its longest time to the end of a frame in s, and how many positions no hand could have reached.
        """
        if self._arm is None:
            return {}
        newest = self._arm.port.newest
        period_ns = float(newest[cells.SEEN_PERIOD])
        rate = {"servo_rate_hz": 1e9 / period_ns} if period_ns else {}
        strange = float(self._arm.cell.strange)
        return {**rate, "write_span_s": float(newest[cells.SEEN_SPAN]), "strange_positions": strange}

    def enable(self) -> None:
        """Enable force, once the arm is calibrated."""
        self._enabled = self._arm is not None
        self._unsettled = True

    def clear_fault(self) -> None:
        """Try again, reopening the arm if necessary; also calibrates an arm held in its reset posture."""
        super().clear_fault()
        if self._arm is not None and self._reopening is None:
            self._wants_reopening = self._wants_reopening or self._is_gone(self._arm)
        self._armed += 1
        self._silent = 0
        self._was_calibrated = False
        self._unsettled = True

    def read(self, time_ns: int, reading: FloatArray) -> None:
        """Write the state read by the scheduler's newest frame."""
        arm = self._arm
        if arm is None:
            reading[:READ_TEMPERATURE] = 0.0
            return
        heard = exchange.look(arm.port.address, arm.has_roll, reading)
        if heard == exchange.CHANGED or (self._unsettled and heard):
            self._judge(arm, arm.port.newest.tolist())
        self._reads += 1
        if self._reads % RAISE_EVERY == 0 and self._session is not None:
            self._session.raise_priority()

    def evaluate(
        self, model: FloatArray, motion: FloatArray, limits: FloatArray, now: FloatArray, memory: FloatArray
    ) -> None:
        """Pass the law's inputs to the scheduler's thread; `memory` is that thread's state when the arm was read."""
        if self._arm is not None:
            time_ns = self._clock.monotonic_ns()
            port = self._arm.port.address
            exchange.give_law(port, time_ns, self._enabled, self._armed, model, limits, now, memory)

    def write(self, force_n: FloatArray) -> None:
        """Order a force instead; an order is trusted for 4 ms."""
        if self._arm is not None:
            self._order(self._arm, force_n)

    def close(self) -> None:
        """Reduce the force to zero at the rig's rate limit, then release the arm."""
        arm, opened = self._arm, self._session
        if self._reopening is not None:
            self._reopening.give_up()
            arm = self._reopening.take_arm()[0] or arm
        self._arm = self._session = self._reopening = None
        self._wants_reopening = False
        self._enabled = self.calibrated = False
        if arm is not None:
            self._order(arm, self._no_force)
            self._wait(arm, _LET_GO_S, lambda seen: not any(seen[cells.SEEN_FORCE : cells.SEEN_MEMORY]))
        if opened is not None:
            opened.leave(self._name)

    def _warm(self) -> None:
        """Compile the kernels of a tick; the orders allow no force."""
        now = np.zeros(NOW_SIZE)
        now[NOW_TTL] = 1.0
        self.evaluate(np.zeros(MODEL_COLUMNS), np.zeros(6), np.ones(LIMIT_SIZE), now, np.zeros(MEMORY_SIZE))
        self.write(self._no_force)
        unreachable(0)

    def _order(self, arm: OpenArm, force_n: FloatArray) -> None:
        exchange.give_force(arm.port.address, self._clock.monotonic_ns(), self._enabled, self._armed, force_n)

    def _wait(self, arm: OpenArm, patience_s: float, condition: Callable[[list[float]], bool]) -> bool:
        until_ns = self._clock.monotonic_ns() + round(1e9 * patience_s)
        while True:
            if exchange.look(arm.port.address, False, self._reading) and condition(arm.port.newest.tolist()):
                return True
            if self._clock.monotonic_ns() > until_ns:
                return False
            self._clock.sleep(1e-3)

    def _judge(self, arm: OpenArm, seen: list[float]) -> None:
        pausing = self._session is not None and self._session.is_pausing
        self._silent = 0 if seen[cells.SEEN_TIME] != self._read_at or pausing else self._silent + 1
        self._read_at = seen[cells.SEEN_TIME]
        self.buttons = int(seen[cells.SEEN_BUTTONS])
        self.calibrated = seen[cells.SEEN_CALIBRATION] == Calibration.OK and not self.is_reopening
        self.prompt = self._ask_person(arm, seen, pausing)
        is_answer = seen[cells.SEEN_ARMED] == self._armed
        if self.is_reopening:
            self._go_on(arm)
        elif is_answer or self._silent >= _SILENT_READS:  # otherwise an error that is forgiven
            self.fault = self.fault or self._problem(seen)
        self._was_calibrated = self._was_calibrated or self.calibrated
        self._unsettled = self.is_reopening or not is_answer or bool(self.prompt or self.fault)

    def _is_gone(self, arm: OpenArm) -> bool:
        """Return whether only reopening it, or restarting the scheduler, can help."""
        seen, session = arm.port.newest, self._session
        if session is None or not session.serves(arm) or seen[cells.SEEN_STOPPED]:
            return True
        return bool(seen[cells.SEEN_ARMED] == self._armed and unreachable(int(seen[cells.SEEN_ERROR])))

    def _go_on(self, arm: OpenArm) -> None:
        """Advance the reopening of the arm without waiting, unless arming the rig was enough."""
        if self._reopening is None:
            if self._session is not None and self._is_gone(arm):
                self._reopening = self._session.reopen(self._name, self._terms, self._where, self._armed)
            elif arm.port.newest[cells.SEEN_ARMED] == self._armed:
                self._wants_reopening = False
            return
        self._reopening.go_on()
        if not self._reopening.ended:
            return
        opened, problem = self._reopening.take_arm()
        self._reopening, self._wants_reopening = None, False
        self._silent, self._was_calibrated = 0, False
        if opened is not None:
            self._arm = opened
            problem = self._weakness(opened)
        self.fault = problem.removeprefix(f"{self._where}: ")

    def _ask_person(self, arm: OpenArm, seen: list[float], pausing: bool) -> str:
        if self.is_reopening:
            return f"{self._shown} is being opened anew"
        if pausing:
            return f"{self._shown} is let go while another arm is being opened anew"
        if not self.calibrated:
            return f"{self._shown}: {_PROMPTS[arm.style]}"
        if not self._enabled or seen[cells.SEEN_TRUST] != 0.0:
            return ""
        if seen[cells.SEEN_REFUSAL]:
            why = describe(int(seen[cells.SEEN_REFUSAL]))
            return f"{self._shown} has refused force, {why}: move out of the contact"
        if seen[cells.SEEN_MEMORY + MEMORY_DEMAND] >= SMALL_FORCE_N:
            return f"{self._shown} was not heard for a moment and bears no force: move out of the contact"
        return ""

    def _problem(self, seen: list[float]) -> str:
        if seen[cells.SEEN_ERROR]:
            return f"{self._shown} reports {describe(int(seen[cells.SEEN_ERROR]))}"
        if seen[cells.SEEN_STOPPED]:
            why = describe(int(seen[cells.SEEN_STOPPED]))
            return f"the scheduler of OpenHaptics has ended: {why}; arm the rig to start it again"
        if seen[cells.SEEN_REFUSED] >= _REFUSED_FRAMES:
            return f"{self._shown} refuses force again and again: {describe(int(seen[cells.SEEN_REFUSAL]))}"
        if self._silent >= _SILENT_READS:
            return f"nothing was read of {self._shown} for {_SILENT_READS} ms"
        if self._was_calibrated and not self.calibrated:
            return f"{self._shown} has lost its calibration"
        return ""


def check_host(settings: Sequence[DriverSettings], in_use: bool) -> Iterator[HostCheck]:
    """Check library, arms, permissions and set-up."""
    own = [config.build(HdapiSettings, each.settings, "driver 'phantom_hdapi'") for each in settings]
    for library in dict.fromkeys(each.library for each in own):
        yield from host_checks.check([each.name for each in own if each.library == library], library, in_use)
