"""A bus for replayed code, with injected states of physics and stored outputs."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from typing import Any

import msgspec

from trocar.protocol import PROTOCOL_VERSION, TOPICS, Frame
from trocar.services.runtime.bus.bus import Bus


class InjectedBus:
    """Inputs and outputs of one process.

    Attributes:
        frame, is_fresh_now: Next result of `latest`, returned once, and of `is_fresh`.
        said: The last published frame of each topic.
        through: The real bus, if any, on which outputs are also published.
        is_live: Whether inputs come from the real bus.
    """

    def __init__(self, through: Bus | None = None) -> None:
        self.frame: Frame | None = None
        self.is_fresh_now = self.is_live = False
        self.said: dict[str, Frame] = {}
        self.through = through

    def latest(self, topic: str) -> Frame | None:
        """Return the injected frame, once."""
        if self.is_live and self.through is not None:
            return self.through.latest(topic)
        frame, self.frame = self.frame, None
        return frame

    def is_fresh(self, *topics: str) -> bool:
        """Return whether the injected frame may be acted on."""
        return self.through.is_fresh(*topics) if self.is_live and self.through is not None else self.is_fresh_now

    def drain(self, _topic: str) -> list[Frame]:
        """Return nothing, as a replay receives no orders."""
        return []

    def publish(
        self, topic: str, body: msgspec.Struct, *, origin_ns: int = 0, valid: bool = True, at_once: bool = False
    ) -> int:
        """Store the frame and pass it on."""
        self.said[topic] = Frame(PROTOCOL_VERSION, topic, TOPICS[topic].version, 0, 0, 0, origin_ns, valid, body)
        if self.through is None:
            return 0
        return self.through.publish(topic, body, origin_ns=origin_ns, valid=valid, at_once=at_once)

    def republish(self, topic: str) -> None:
        """Publish the last frame again, in case its receiver has missed it."""
        if topic in self.said:
            last = self.said[topic]
            self.publish(topic, last.body, origin_ns=last.origin_ns, valid=last.valid, at_once=True)


@dataclass
class NoHealth:
    """Placeholder of a health reporter."""

    gauges: dict[str, float] = field(default_factory=dict)
    counts: Any = dict
    quality_level: int = 0

    def do_a_piece(self) -> bool:
        """Do nothing."""
        return False


@dataclass
class InjectedProcess:
    """The part of a process used by haptics and physics."""

    bus: InjectedBus = field(default_factory=InjectedBus)
    health: Any = field(default_factory=NoHealth)
    log: logging.Logger = field(default_factory=lambda: logging.getLogger("rerun"))
