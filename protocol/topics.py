"""The topic table: one row per topic drives sockets, staleness, recorder, dashboard, documentation and tests.

Adding a topic is one row here and one body in `protocol.bodies`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import msgspec

from protocol import bodies

PROCESSES = ("physics", "haptics", "gateway", "visualization", "recorder", "supervisor")


@dataclass(frozen=True, slots=True)
class Topic:
    """A row of the table.

    `delivery` "latest": a reader keeps the newest frame only; "every": all frames in order, drops counted.
    `command`: a reader acts or computes with it, so a number that is not finite refuses the whole frame.
    """

    name: str
    publisher: str
    readers: tuple[str, ...]
    body: type[msgspec.Struct]
    version: int
    rate_hz: float
    delivery: Literal["latest", "every"]
    stale_after_s: float
    command: bool = False


_MOTION = 0.005  # seconds: five ticks; what moves the hand is stale after that


def _row(name: str, readers: str, body: type[msgspec.Struct], version: int) -> Topic:
    """Return a 1 kHz state topic: others compute with it, so that every number must be one."""
    publisher = name.split(".")[0]
    return Topic(name, publisher, tuple(readers.split()), body, version, 1000.0, "latest", _MOTION, command=True)


def _health(process: str) -> Topic:
    reader = "recorder" if process == "supervisor" else "supervisor"
    return Topic(f"{process}.health", process, (reader,), bodies.Health, 1, 10.0, "latest", 0.5)


_EVERYONE = ("physics", "haptics", "gateway", "visualization", "recorder")

_ROWS = (
    _row("gateway.state", "haptics visualization recorder", bodies.GatewayState, 1),
    _row("haptics.contact_model", "gateway recorder", bodies.ContactModel, 2),
    _row("haptics.contacts", "physics recorder", bodies.ToolContacts, 2),
    _row("physics.duct", "haptics visualization recorder", bodies.Duct, 2),
    _row("physics.catheter", "haptics visualization recorder", bodies.Catheter, 2),
    _row("physics.contacts", "haptics visualization recorder", bodies.PhysicsContacts, 2),
    *(_health(process) for process in PROCESSES),
    Topic("supervisor.state", "supervisor", _EVERYONE, bodies.SupervisorState, 1, 10.0, "every", 0.5, command=True),
)

TOPICS: dict[str, Topic] = {row.name: row for row in _ROWS}


def topic(name: str) -> Topic:
    """Return the row of `name`.

    Raises
    ------
    KeyError
        with the known names, if there is no such topic.
    """
    try:
        return TOPICS[name]
    except KeyError:
        raise KeyError(f"no topic {name!r}; known: {', '.join(TOPICS)}") from None


def published_by(process: str) -> tuple[Topic, ...]:
    """Return the rows that `process` publishes."""
    return tuple(row for row in _ROWS if row.publisher == process)


def read_by(process: str) -> tuple[Topic, ...]:
    """Return the rows that `process` reads."""
    return tuple(row for row in _ROWS if process in row.readers)
