"""Interface between the page and a recording whose pictures are shown."""

from __future__ import annotations

from typing import Protocol

import trocar.protocol.bodies as bodies


class ShownRecording(Protocol):
    """A player of the recording."""

    def obey(self, line: str) -> None:
        """Execute a command typed or sent by the page."""

    def status(self) -> bodies.ReplayReport:
        """Return the state of the replay."""
