"""Commands of the supervisor to the gateway: let every hand go, and allow force again."""

from __future__ import annotations

from protocol import Frame
from services.gateway.instrument import Instrument
from services.runtime.stop_line import StopLine


class SupervisorCommands:
    """Obeys ``supervisor.state``. A safe stop is latched: only its own supervisor's "no longer" ends it.

    A supervisor that starts anew does not know of the stop; its silence about it must not arm the rig. A rig that is
    armed while it runs has what is at fault tried again; no other hand is let go for that.

    Args:
        instruments: That obey.
        timeout_s: A supervisor that is silent for so long can no longer stop anything: every hand is let go, as when
            the stream of models dies, until one is heard again. None: the rig has none.

    Attributes:
        unsupervised: Whether hands are let go for that.
        line: Where anybody may ask for a safe stop; then the supervisor makes it its own, which ends as any.
    """

    def __init__(self, instruments: list[Instrument], timeout_s: float | None) -> None:
        self.stopped = False
        self.unsupervised = False
        self.line: StopLine | None = None
        self._instruments = instruments
        self._timeout_ns = None if timeout_s is None else round(timeout_s * 1e9)
        self._heard_ns: int | None = None
        self._stopped_by = -1
        self._armed = -1, 0  # by whom, how often so far

    def obey(self, frames: list[Frame], now_ns: int) -> None:
        """Follow the frames since the last call, oldest first."""
        if self.line is not None and self.line.is_asked() and not self.stopped:
            self._stop(-1)
        if frames:
            self._heard_ns = now_ns
        if self._timeout_ns is not None:
            self._watch(self._heard_ns is None or now_ns - self._heard_ns > self._timeout_ns)
        for frame in frames:
            is_armed = self._is_armed(frame)
            if frame.body.safe_stop:
                self._stop(frame.incarnation)
            elif self.stopped and frame.incarnation == self._stopped_by:
                self.stopped = False
                for instrument in self._instruments:
                    instrument.arm_anew()
            elif is_armed and not self.stopped:
                for instrument in self._instruments:
                    instrument.try_again()

    @property
    def told(self) -> float:
        """What the supervisor is told: 0 for no safe stop, 1 for its own, 2 for one that it is to make its own."""
        return float(self.stopped) * (2.0 if self._stopped_by == -1 else 1.0)

    def _stop(self, by: int) -> None:
        self.stopped, self._stopped_by = True, by
        for instrument in self._instruments:
            instrument.servo.engagement.stop()

    def _is_armed(self, frame: Frame) -> bool:
        """Return whether a person has armed the rig since the last frame of this supervisor."""
        by, times = self._armed
        self._armed = frame.incarnation, frame.body.armed
        return by == frame.incarnation and frame.body.armed > times

    def _watch(self, unsupervised: bool) -> None:
        if unsupervised is not self.unsupervised:
            self.unsupervised = unsupervised
            for instrument in self._instruments:
                instrument.servo.engagement.unsupervised = unsupervised
