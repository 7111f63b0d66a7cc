"""A recording whose pictures are shown again: what the page is told of it, and what the page may ask."""

from __future__ import annotations

from typing import Protocol

import msgspec

import protocol.bodies as bodies


class ReplayStatus(msgspec.Struct, frozen=True, kw_only=True):
    """Where a recording stands: seconds since its first frame; `attempt` is what was told of it then."""

    file: str
    place_s: float
    length_s: float
    rate: float
    halted: bool
    loop: bool
    attempt: bodies.Attempt | None = None


class ShownRecording(Protocol):
    """Who shows it."""

    def obey(self, line: str) -> None:
        """Do what a person has typed, or asked for at the page."""

    def status(self) -> ReplayStatus:
        """Return where it stands."""
