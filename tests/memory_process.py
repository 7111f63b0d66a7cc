"""What gateway, haptics and physics ask of their process, in memory and in time that a test lets pass."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

import trocar.services.gateway.__main__ as gateway_process
from tests import memory_bus
from tests.memory_bus import MemoryBus, MemoryHub
from trocar.protocol import TOPICS
from trocar.protocol.topics import published_by, read_by
from trocar.services.gateway.instruments import instrument
from trocar.services.runtime.bus import bus
from trocar.services.runtime.process import health
from trocar.services.runtime.process.health import HealthReporter


@dataclass
class MemoryProcess:
    """A process of the topic table on a hub in memory, which nobody stops."""

    name: str
    hub: MemoryHub
    rig: Any = None
    log: logging.Logger = field(default_factory=lambda: logging.getLogger("test"))

    def __post_init__(self) -> None:
        every = [name for name in read_by(self.name) if TOPICS[name].delivery == "every"]
        latest = [name for name in read_by(self.name) if name not in every]
        self.bus = MemoryBus(self.hub, publishes=published_by(self.name), reads=latest, reads_every=every)
        self.health = HealthReporter(self.name, self.bus)

    def stop(self) -> bool:
        return False


def in_time_of(
    monkeypatch: pytest.MonkeyPatch, monotonic_ns: Callable[[], int], sleep_until: Callable[[int], None]
) -> None:
    """Give gateway, bus and health the time of `monotonic_ns`, and the gateway the sleep of `sleep_until`."""
    fake_time = SimpleNamespace(monotonic_ns=monotonic_ns)
    for module in (gateway_process, instrument, bus, health, memory_bus):
        monkeypatch.setattr(module, "time", fake_time)
    monkeypatch.setattr(gateway_process, "sleep_until", sleep_until)
