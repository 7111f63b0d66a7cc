"""Interface of observers, which sample data beside the rig's own reports, and report rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

import trocar.protocol.bodies as bodies

T = TypeVar("T")
L = TypeVar("L")


@dataclass(frozen=True, slots=True)
class RigSight:
    """The rig's state for observers: process ids and newest reports by process, and why a process is down."""

    now_s: float
    pids: Mapping[str, int] = field(default_factory=dict)
    heard: Mapping[str, bodies.Health] = field(default_factory=dict)
    down: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Row(Generic[T, L]):
    """One reported row: counts since the start, for /metrics, and recent ones, for the page."""

    since_start: T
    lately: L


class Observer(Protocol):
    """Samples a few times a second and never waits."""

    def sample(self, sight: RigSight) -> None:
        """Sample, if due."""

    def report(self) -> Mapping[Any, Row[Any, Any]]:
        """Return the rows by core, process or file."""

    def close(self) -> None:
        """End whatever was started."""
