"""A bus for code that is run again: what it sees of physics is put in, what it says is kept."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from typing import Any

import msgspec

from protocol import PROTOCOL_VERSION, TOPICS, Frame
from services.runtime.bus import Bus


class InjectedBus:
    """What one process says and sees.

    Attributes:
        frame, is_fresh_now: What `latest` returns next, once, and whether it may be acted on.
        said: The last frame of each topic that was published.
        through: The real bus, where there is one: what is said is published there too.
        is_live: Whether everything is asked of the real bus.
    """

    def __init__(self, through: Bus | None = None) -> None:
        self.frame: Frame | None = None
        self.is_fresh_now = self.is_live = False
        self.said: dict[str, Frame] = {}
        self.through = through

    def latest(self, topic: str) -> Frame | None:
        """Return what was put in, if it was not returned before."""
        if self.is_live and self.through is not None:
            return self.through.latest(topic)
        frame, self.frame = self.frame, None
        return frame

    def is_fresh(self, *topics: str) -> bool:
        """Return whether what was put in may be acted on."""
        return self.through.is_fresh(*topics) if self.is_live and self.through is not None else self.is_fresh_now

    def drain(self, _topic: str) -> list[Frame]:
        """Return nothing: nobody gives orders to what has happened."""
        return []

    def publish(
        self, topic: str, body: msgspec.Struct, *, origin_ns: int = 0, valid: bool = True, at_once: bool = False
    ) -> int:
        """Keep what is said, and pass it on."""
        self.said[topic] = Frame(PROTOCOL_VERSION, topic, TOPICS[topic].version, 0, 0, 0, origin_ns, valid, body)
        if self.through is None:
            return 0
        return self.through.publish(topic, body, origin_ns=origin_ns, valid=valid, at_once=at_once)

    def republish(self, topic: str) -> None:
        """Publish what was said last: whoever waits for it may have missed it."""
        if topic in self.said:
            last = self.said[topic]
            self.publish(topic, last.body, origin_ns=last.origin_ns, valid=last.valid, at_once=True)


@dataclass
class NoHealth:
    """Figures that nobody asks for."""

    gauges: dict[str, float] = field(default_factory=dict)
    counts: Any = dict
    quality_level: int = 0

    def do_a_piece(self) -> bool:
        """Nothing is reported."""
        return False


@dataclass
class InjectedProcess:
    """What haptics and physics ask of their process."""

    bus: InjectedBus = field(default_factory=InjectedBus)
    health: Any = field(default_factory=NoHealth)
    log: logging.Logger = field(default_factory=lambda: logging.getLogger("rerun"))
