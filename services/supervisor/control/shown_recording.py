"""Interface between the page and a recording whose pictures are shown."""

from __future__ import annotations

from typing import Protocol

import msgspec

import trocar.protocol.bodies as bodies


class ReplayStatus(msgspec.Struct, frozen=True, kw_only=True):
    """State of a replay: seconds since the first frame; `attempt` is the attempt's report of that time."""

    file: str
    place_s: float
    length_s: float
    rate: float
    halted: bool
    loop: bool
    attempt: bodies.Attempt | None = None


class ShownRecording(Protocol):
    """A player of the recording."""

    def obey(self, line: str) -> None:
        """Execute a command typed or sent by the page."""

    def status(self) -> ReplayStatus:
        """Return the state of the replay."""
