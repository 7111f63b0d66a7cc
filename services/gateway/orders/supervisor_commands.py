"""Commands of the supervisor to the gateway: safe stop, and arming."""

from __future__ import annotations

from trocar.protocol import Frame
from trocar.services.gateway.instruments.instrument import Instrument
from trocar.services.runtime.bus.stop_line import StopLine


class SupervisorCommands:
    """Follows ``supervisor.state``. A safe stop is latched until the same supervisor ends it.

    A restarted supervisor does not know of the stop, so the absence of it in its messages must not arm the rig. Arming
    a running rig retries devices with a fault; other hands keep their force.

    Args:
        instruments: The commanded instruments.
        timeout_s: If the supervisor is silent for so long, nobody could stop the rig: all forces are removed, as when
            the stream of models ends, until one is heard again. None for a rig without a supervisor.

    Attributes:
        unsupervised: Whether forces are removed for that reason.
        line: Line by which anybody may request a safe stop, which the supervisor then adopts.
    """

    def __init__(self, instruments: list[Instrument], timeout_s: float | None) -> None:
        self.stopped = False
        self.unsupervised = False
        self.line: StopLine | None = None
        self._instruments = instruments
        self._timeout_ns = None if timeout_s is None else round(timeout_s * 1e9)
        self._heard_ns: int | None = None
        self._stopped_by = -1
        self._armed = -1, 0  # incarnation of the supervisor, and how often it has armed the rig

    def obey(self, frames: list[Frame], now_ns: int) -> None:
        """Process the frames since the last call, oldest first."""
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
                    instrument.rearm()
            elif is_armed and not self.stopped:
                for instrument in self._instruments:
                    instrument.try_again()

    @property
    def stop_report(self) -> float:
        """Report to the supervisor: 0 without a safe stop, 1 for its own, 2 for one that it is to adopt."""
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
