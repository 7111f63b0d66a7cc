"""The topic table: one row per topic drives sockets, staleness, recorder, dashboard, documentation and tests.

Adding a topic is one row here and one body in `trocar.protocol.bodies`: whom the row names gets a socket, nobody else
does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import msgspec

from trocar.protocol.bodies import gateway, haptics, health, journal, physics, supervisor, training, visualization

PROCESSES = ("physics", "haptics", "gateway", "visualization", "recorder", "training", "supervisor")


@dataclass(frozen=True, slots=True)
class Topic:
    """A row of the table.

    Attributes:
        readers: Processes that get every frame that they are quick enough for: whoever acts on the topic.
        observers: Processes that look at a frame now and then, and cost the publisher nothing in between.
        delivery: "latest": a reader keeps the newest frame only; "every": all frames in order, drops counted.
        command: A reader acts or computes with it, so a number that is not finite refuses the whole frame.
    """

    name: str
    publisher: str
    readers: tuple[str, ...]
    observers: tuple[str, ...]
    body: type[msgspec.Struct]
    version: int
    rate_hz: float
    delivery: Literal["latest", "every"]
    stale_after_s: float
    command: bool = False


TICK_S = 1e-3
"""A tick: the period of the loops, and of the state topics: 1 kHz, as Basdogan et al. (2001) and vendors' loops have.
"""
TICK_NS = round(1e9 * TICK_S)
TICK_HZ = float(round(1.0 / TICK_S))
HEALTH_S = 0.1
"""Period of all that processes say of themselves: a report takes up to 0.4 ms, so a process spends 0.4 % on them."""
HEARTBEAT_S = 5 * HEALTH_S
"""Silence from which on a process counts as gone: five reports, as single ones are late on a busy machine."""
JUDGEMENT_S = 2 * HEALTH_S
"""Period of what is told to people: numbers that change more than five times a second cannot be read."""
ORDER_S = 2.0
"""Age from which on nobody carries out an order of the attempt, as the page (2.5 s) has given up soon after it."""
MOMENT_TICKS = 40
"""Ticks between two moments: 25 a second, as many pictures as a film has; to send every tick twice would cost as much
again."""
_MOTION = 5 * TICK_S  # what moves the hand is stale after so long, as the servo holds a model no longer than 5 ms


def _state(name: str, readers: str, observers: str, body: type[msgspec.Struct], version: int) -> Topic:
    """Return a 1 kHz state topic: others compute with it, so that every number must be one."""
    return Topic(
        name, name.split(".")[0], tuple(readers.split()), tuple(observers.split()), body, version,
        TICK_HZ, "latest", _MOTION, command=True,
    )  # fmt: skip


def _moment(process: str, readers: str, body: type[msgspec.Struct], version: int) -> Topic:
    """Return the topic of a loop's moments, which are sent in simulated time only, see `services.runtime.tick_grid`."""
    return Topic(
        f"{process}.moment",
        process,
        tuple(readers.split()),
        (),
        body,
        version,
        TICK_HZ / MOMENT_TICKS,
        "every",
        HEARTBEAT_S,
        command=True,
    )


def _health(process: str) -> Topic:
    reader = "recorder" if process == "supervisor" else "supervisor"
    return Topic(f"{process}.health", process, (reader,), (), health.Health, 1, 1.0 / HEALTH_S, "latest", HEARTBEAT_S)


def _journal(process: str) -> Topic:
    """Return a topic that says what a loop took in: for recordings, which need all of it."""
    return Topic(
        f"{process}.journal", process, ("recorder",), (), journal.Journal, 1, 1.0 / HEALTH_S, "every", HEARTBEAT_S
    )


_OBEYING = ("physics", "gateway", "visualization", "recorder", "training")

_ROWS = (
    _state("gateway.state", "haptics", "visualization recorder training supervisor", gateway.GatewayState, 1),
    _state("haptics.contact_model", "gateway", "recorder supervisor", haptics.ContactModel, 3),
    _state("haptics.contacts", "physics", "recorder training", haptics.ToolContacts, 5),
    _state("physics.state", "haptics", "visualization recorder training supervisor", physics.PhysicsState, 2),
    _moment("gateway", "training", gateway.GatewayState, 1),
    _moment("haptics", "recorder training", haptics.ToolContacts, 5),
    _moment("physics", "recorder training", physics.PhysicsState, 2),
    Topic(
        "visualization.hands",
        "visualization",
        ("gateway", "training"),
        (),
        visualization.Hands,
        1,
        60.0,
        "latest",
        0.25,
        True,
    ),
    Topic(
        "training.attempt",
        "training",
        ("gateway", "recorder", "supervisor"),
        (),
        training.Attempt,
        1,
        1.0 / HEALTH_S,
        "latest",
        1.0,
        command=True,
    ),
    *(_health(process) for process in PROCESSES),
    Topic(
        "supervisor.state",
        "supervisor",
        _OBEYING,
        (),
        supervisor.SupervisorState,
        1,
        1.0 / HEALTH_S,
        "every",
        HEARTBEAT_S,
        command=True,
    ),
    Topic(
        "supervisor.judgement",
        "supervisor",
        (),  # for observers that are no process of the rig: the page, and whoever sniffs
        (),
        supervisor.Judgement,
        1,
        1.0 / JUDGEMENT_S,
        "latest",
        10 * JUDGEMENT_S,  # as the page is to tell of a supervisor that hangs, not of one that waits for a processor
    ),
    *(_journal(process) for process in ("haptics", "physics")),
)

TOPICS: dict[str, Topic] = {row.name: row for row in _ROWS}


def topic(name: str) -> Topic:
    """Return the row of `name`. Raises KeyError with the known names, if there is no such topic."""
    try:
        return TOPICS[name]
    except KeyError:
        raise KeyError(f"no topic {name!r}; known: {', '.join(TOPICS)}") from None


def published_by(process: str) -> tuple[str, ...]:
    """Return the topics that `process` publishes."""
    return tuple(row.name for row in _ROWS if row.publisher == process)


def read_by(process: str) -> tuple[str, ...]:
    """Return the topics of which `process` gets every frame, or the newest."""
    return tuple(row.name for row in _ROWS if process in row.readers)


def observed_by(process: str) -> tuple[str, ...]:
    """Return the topics of which `process` takes a frame now and then."""
    return tuple(row.name for row in _ROWS if process in row.observers)
