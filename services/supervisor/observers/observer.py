"""What an observer is: it samples something beside the rig's own reports, and reports rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

import protocol.bodies as bodies

T = TypeVar("T")
L = TypeVar("L")


@dataclass(frozen=True, slots=True)
class RigSight:
    """What observers are shown of the rig: process ids and newest reports by process, and why a process is down."""

    now_s: float
    pids: Mapping[str, int] = field(default_factory=dict)
    heard: Mapping[str, bodies.Health] = field(default_factory=dict)
    down: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Row(Generic[T, L]):
    """One reported row: counts since the start, as /metrics exports them, and lately, as the page shows them."""

    since_start: T
    lately: L


class Observer(Protocol):
    """Samples a few times a second and never waits."""

    def sample(self, sight: RigSight) -> None:
        """Look, if it is time to."""

    def report(self) -> Mapping[Any, Row[Any, Any]]:
        """Return the rows, each under the core, the process or the file that it is about."""

    def close(self) -> None:
        """End what was started."""
