"""What the supervisor tells the gateway: let go, and allow again."""

from __future__ import annotations

from protocol import Frame
from services.gateway.instrument import Instrument


class Orders:
    """Obeys ``supervisor.state``. A safe stop is latched: only its own supervisor's "no longer" ends it.

    A supervisor that starts anew does not know of the stop; its silence about it must not arm the rig.
    """

    def __init__(self, instruments: list[Instrument]) -> None:
        self.stopped = False
        self._instruments = instruments
        self._stopped_by = -1

    def obey(self, frames: list[Frame]) -> None:
        """Follow the frames since the last call, oldest first."""
        for frame in frames:
            if frame.body.safe_stop:
                self.stopped = True
                self._stopped_by = frame.incarnation
                for instrument in self._instruments:
                    instrument.servo.engagement.stop()
            elif self.stopped and frame.incarnation == self._stopped_by:
                self.stopped = False
                for instrument in self._instruments:
                    instrument.arm_anew()
