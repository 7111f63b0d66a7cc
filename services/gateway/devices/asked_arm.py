"""An arm behind another program or thread, which takes a force and answers with the arm's state.

An exchange goes on while the gateway does other things: a tick asks with its force, the next reads what was answered.
So neither waits, and what is read is at most as old as its question. That age is told to the servo's law, as a part of
the time from reading to writing. Nothing is asked before the last question is answered: a program that stood still must
not get two forces at once, nor old ones.

What is answered may be late, missing or wrong. A place is believed if a hand may have reached it; otherwise the last
stays. Without one for `SILENT_NS` the arm has a fault, and a person has to arm the rig, which opens the arm anew.
An arm that bears no force, as it is away for a moment or its motors are off, is given none: the next rises from there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from trocar.protocol.topics import TICK_NS, TICK_S
from trocar.services.gateway.devices.background_open import BackgroundOpen
from trocar.services.gateway.devices.clock import Clock
from trocar.services.gateway.devices.device_files import ArmFile
from trocar.services.gateway.devices.driver import Arm, Place
from trocar.services.gateway.devices.limited_force import NO_FORCE, LimitedForce
from trocar.services.gateway.devices.measured_motion import MeasuredMotion
from trocar.services.gateway.servo.servo_arrays import FLIGHTS, READ_ROLL, READ_TEMPERATURE
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.config.rig import Vector3
from trocar.services.runtime.errors import DeviceError

#: Time without a believed place after which the arm is not used; and after which its velocity is not known. A program
#: without real-time priority may stand still for some 10 ms on a busy host: meanwhile forces fade, as they are late.
SILENT_NS, RESTING_NS = 200_000_000, 5_000_000
#: A force that was given otherwise than it was ordered is told to have come this late, which no books cover.
_LATE_NS = (FLIGHTS + 1) * TICK_NS
#: Share of a newest tick in a mean, and mean share of ticks without an answer from which on forces come too late.
_NEWEST, _SLOW = 0.02, 0.3
#: How long an arm may take until it tells its place, and to be free of force: that falls from 3 N in 15 ms (200 N/s).
#: The first is an assumption: what runs answers within milliseconds.
OPEN_S, CLOSE_S = 2.0, 0.05


@dataclass(frozen=True, slots=True)
class ArmAnswer:
    """What was answered; None: not told.

    Attributes:
        asked_ns: When the question was asked that this answers.
        place_m: Where the arm is, in its frame.
        problem: Why it tells no place, or must not be used.
        prompt: What a person has to do.
        limp: Whether the arm bears no force, whatever it is given: it is away, has no power, or its motors are off.
    """

    asked_ns: int
    place_m: Vector3 | None = None
    roll_rad: float | None = None
    buttons: int = 0
    calibrated: bool | None = None
    problem: str = ""
    prompt: str = ""
    limp: bool = False


class ArmConnection(ABC):
    """The connection to an arm that is open."""

    @abstractmethod
    def answers(self, now_ns: int) -> list[ArmAnswer]:
        """Return what was answered since the last call. Never waits."""

    @abstractmethod
    def ask_state(self, force_n: Vector3, now_ns: int) -> None:
        """Ask for the arm's state, giving it a force in its frame. Never waits."""

    @property
    @abstractmethod
    def outstanding(self) -> int:
        """How many questions have no answer yet."""

    @property
    @abstractmethod
    def lost(self) -> str:
        """Empty, or one sentence on why there will be no more answers."""

    @abstractmethod
    def close(self) -> None:
        """Let the arm go."""

    def switch_on(self) -> None:  # noqa: B027 - most arms push whenever they are told to
        """Switch the motors on."""

    def gauges(self) -> dict[str, float]:
        """Return figures for the dashboard, by name."""
        return {}


class AskedArm(Arm):
    """Exchanges with an arm once a tick; a driver says how it is opened.

    Args:
        shown: How sentences name the arm.
    """

    def __init__(self, file: ArmFile, place: Place, shown: str) -> None:
        self.limits = file.limits()
        self.calibrated = False
        self.where = f"instrument {place.instrument!r}"
        self.shown = shown
        self._clock: Clock = place.clock
        self._rate_n_s = place.force_rate_n_s
        self._motion = MeasuredMotion(file.velocity_filter_hz)
        self._force = LimitedForce(place.force_rate_n_s)
        self._link: ArmConnection | None = None
        self._opening: BackgroundOpen[ArmConnection] | None = None
        self._roll_rad = 0.0
        self._enabled = self._as_ordered = self._was_calibrated = self._limp = False
        self._problem = self._told_prompt = ""
        self._wrote_ns = self._between_ns = 0  # the last write, and the time from the one before to it
        self._silent_ns = self._read_ns = 0  # how long reads have told nothing that was believed, and the last read
        self._missed = 0.0  # mean share of ticks in which nothing could be asked

    @abstractmethod
    def connect(self) -> ArmConnection:
        """Open the arm and return the connection; may take seconds.

        Raises DeviceError: one sentence.
        """

    def open(self) -> None:
        """Open the arm and wait until it tells where it is."""
        link = self.connect()
        self._begin_exchange(link)
        until_ns = self._clock.monotonic_ns() + round(1e9 * OPEN_S)
        while not self._motion.sampled_ns and not link.lost and self._clock.monotonic_ns() < until_ns:
            self._exchange(link, NO_FORCE)
            self._clock.sleep(TICK_S)
            self._hear(link, self._clock.monotonic_ns())
        if not self._motion.sampled_ns:
            raise DeviceError(
                f"{self.where}: {link.lost or self._problem or f'{self.shown} does not tell where it is'}"
            )

    def enable(self) -> None:
        """Let forces through."""
        self._enabled = self._link is not None
        if self._link is not None:
            self._link.switch_on()

    def clear_fault(self) -> None:
        """Open an arm with a fault anew, in the background."""
        has_fault = bool(self.fault)
        super().clear_fault()
        if has_fault and self._link is not None and self._opening is None:
            old = self._link
            self._opening = BackgroundOpen(lambda: self._open_anew(old))

    def read(self, time_ns: int, reading: FloatArray) -> None:
        """Write the newest believed place."""
        link = self._link
        if link is None:
            reading[:READ_TEMPERATURE] = 0.0
            return
        if self._opening is not None and self._opening.done:
            link = self._take_over(self._opening, link)
        now_ns = self._clock.monotonic_ns()
        self._silent_ns += min(now_ns - self._read_ns, RESTING_NS)  # of a longer time this process was busy
        self._read_ns = now_ns
        if self._opening is None:
            self._hear(link, now_ns)
        self._judge(link)
        self._motion.write(reading)
        reading[READ_ROLL] = self._roll_rad

    def write(self, force_n: FloatArray) -> None:
        """Ask with this force, unless the last question has no answer yet."""
        link = self._link
        if link is None or self._opening is not None:
            self._as_ordered, self.skipped = False, 0
            return
        now_ns = self._clock.monotonic_ns()
        self._between_ns, self._wrote_ns = now_ns - self._wrote_ns, now_ns
        x, y, z = force_n.tolist()
        asked = self._exchange(link, (x, y, z) if self._enabled and self.calibrated else NO_FORCE)
        self.skipped = 0 if asked else self.skipped + 1
        self._missed += _NEWEST * (float(not asked) - self._missed)

    def write_span_ns(self, read_ns: int, written_ns: int) -> int:
        """Return how old the place was that the newest force answers; never less than what the tick took.

        One that was not asked comes with the next, a tick later at least; the law is told how many there are in a row.
        """
        age_ns = self._clock.monotonic_ns() - self._motion.sampled_ns
        if self.skipped:
            age_ns += max(TICK_NS, self._between_ns)
        return max(written_ns - read_ns, min(age_ns if self._as_ordered or self.skipped else _LATE_NS, _LATE_NS))

    def gauges(self) -> dict[str, float]:
        """Return the rate of answers in Hz, how many places were not believed, and the connection's own figures."""
        if self._link is None:
            return {}
        own = {"servo_rate_hz": 1.0 / self._motion.period_s, "strange_positions": float(self._motion.strange)}
        return {**own, **self._link.gauges()}

    def close(self) -> None:
        """Take the force away, hear that it was, and let the arm go."""
        opening, link = self._opening, self._link
        self._opening = self._link = None
        self._enabled = self.calibrated = self._as_ordered = False
        if opening is not None:
            link = opening.take_opened()[0] or link
        if link is None:
            return
        until_ns = self._clock.monotonic_ns() + round(1e9 * CLOSE_S)
        asked = False
        while not link.lost and self._clock.monotonic_ns() < until_ns and not (asked and link.outstanding == 0):
            asked = self._exchange(link, NO_FORCE) or asked
            self._clock.sleep(TICK_S)
            link.answers(self._clock.monotonic_ns())
        link.close()

    def _begin_exchange(self, link: ArmConnection) -> None:
        self._link = link
        self._motion.forget_motion()
        self._force = LimitedForce(self._rate_n_s)
        self.calibrated = self._was_calibrated = self._limp = False
        self._missed = 0.0
        self._problem = self._told_prompt = ""
        self._silent_ns, self._read_ns = 0, self._clock.monotonic_ns()

    def _open_anew(self, old: ArmConnection) -> ArmConnection:
        old.close()
        return self.connect()

    def _take_over(self, opening: BackgroundOpen[ArmConnection], old: ArmConnection) -> ArmConnection:
        self._opening = None
        link, problem = opening.take_opened()
        if link is None:
            self.fault = problem.removeprefix(f"{self.where}: ")
            return old
        self._begin_exchange(link)
        if self._enabled:
            link.switch_on()
        return link

    def _exchange(self, link: ArmConnection, force_n: Vector3) -> bool:
        self._as_ordered = False
        if link.lost or link.outstanding:
            return False
        now_ns = self._clock.monotonic_ns()
        wanted = NO_FORCE if self._limp else force_n
        given, as_wanted = self._force.next(wanted, now_ns)
        self._as_ordered = as_wanted and wanted == force_n
        link.ask_state(given, now_ns)
        return True

    def _hear(self, link: ArmConnection, now_ns: int) -> None:
        """Take the newest of what was answered."""
        answers = link.answers(now_ns)
        if not answers:
            return
        newest = answers[-1]
        self._problem, self._told_prompt, self.buttons = newest.problem, newest.prompt, newest.buttons
        self._limp = newest.limp
        if newest.calibrated is not None:
            self.calibrated = newest.calibrated
        if newest.roll_rad is not None:
            self._roll_rad = newest.roll_rad
        if newest.place_m is not None and self._motion.take_place(newest.place_m, newest.asked_ns):
            self._silent_ns = 0

    def _judge(self, link: ArmConnection) -> None:
        if self._opening is not None:
            self.calibrated = False
            self.prompt = f"{self.shown} is being opened anew"
            return
        silent = self._silent_ns > SILENT_NS
        if self._silent_ns > RESTING_NS or link.lost:
            self._motion.rest()
        self.fault = self.fault or self._find_fault(link, silent)
        self._was_calibrated = self._was_calibrated or self.calibrated
        self.prompt = self._told_prompt or self._find_prompt()

    def _find_fault(self, link: ArmConnection, silent: bool) -> str:
        if link.lost:
            return link.lost
        if silent:
            return self._problem or f"nothing was read of {self.shown} for {1e-6 * SILENT_NS:g} ms"
        if self._was_calibrated and not self.calibrated:
            return f"{self.shown} has lost its calibration"
        return ""

    def _find_prompt(self) -> str:
        if not self.calibrated:
            return f"{self.shown} is not calibrated: move it a little, as its maker says"
        if self._missed > _SLOW:
            rate_hz = 1.0 / self._motion.period_s
            return f"{self.shown} answers {rate_hz:.0f} times a second only, so its forces come too late to be felt"
        return ""
