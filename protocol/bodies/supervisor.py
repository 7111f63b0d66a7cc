"""What the supervisor says to everyone."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from trocar.protocol.bodies.training import Attempt

LINE_CHARS = 2048
"""Longest text of an event, as the supervisor reads 2000 characters of a line that a process writes."""
EVENTS_TOLD = 50
"""Newest events that a judgement tells, as a screen has fewer lines; the log has all of them."""


class ProcessReport(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """One process of the rig as the supervisor judges it."""

    name: Annotated[str, Meta(max_length=32)]
    state: Annotated[str, Meta(max_length=16)]
    pid: Annotated[int, Meta(ge=0)] = 0
    restarts: Annotated[int, Meta(ge=0)] = 0
    reason: Annotated[str, Meta(max_length=256)] = ""


class QualityReport(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """The rung of the scene's quality ladder that is in force, with what `trocar tune` measured: errors are root mean
    square, against the converged reference.
    """

    name: Annotated[str, Meta(max_length=64)] = "full"
    rungs: Annotated[int, Meta(ge=1, le=16, description="of the whole ladder")] = 1
    cost_us: Annotated[float | None, Meta(description="of a tick of physics; none: not measured")] = None
    force_error_percent: float | None = None
    motion_error_percent: float | None = None
    lowered: Annotated[int, Meta(ge=0, description="how often since the start")] = 0
    raised: Annotated[int, Meta(ge=0, description="how often since the start")] = 0


class Order(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """A person's command to the attempt; one that is too old is ignored."""

    id: Annotated[int, Meta(ge=0, lt=1 << 53, description="random; the answer repeats it")]
    what: Annotated[str, Meta(max_length=16, description="new, pause, resume, step, slow or bookmark")]
    value: Annotated[float, Meta(description="ticks of a step, pace of slow motion")] = 0.0
    age_s: Annotated[float, Meta(ge=0.0, description="since it was asked, when this frame was sent")] = 0.0


class SupervisorState(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """State of the rig, and commands to its processes."""

    state: Annotated[str, Meta(max_length=16, description="off, starting, ready, running, degraded or safe_stop")]
    quality_level: Annotated[int, Meta(ge=0, lt=16, description="0 is the best")] = 0
    safe_stop: Annotated[
        bool, Meta(description="true: the gateway lets the arms go limp until the rig is armed anew")
    ] = False
    reason: Annotated[
        str, Meta(max_length=512, description="what is wrong: names topic or process, value and limit")
    ] = ""
    processes: Annotated[tuple[ProcessReport, ...], Meta(max_length=16)] = ()
    token_sha256: Annotated[
        str, Meta(max_length=64, description="of the session's token, which every command must carry")
    ] = ""
    quality: QualityReport = QualityReport()
    armed: Annotated[
        int, Meta(ge=0, description="how often a person has armed the rig, after which faulty devices are tried again")
    ] = 0
    orders: Annotated[tuple[Order, ...], Meta(max_length=8, description="to the training process, of late")] = ()


class Event(msgspec.Struct, array_like=True, frozen=True):
    """A message for people."""

    t: Annotated[float, Meta(description="seconds since the supervisor's start")]
    level: Annotated[str, Meta(max_length=16, description="info, warning or error")]
    text: Annotated[str, Meta(max_length=LINE_CHARS)]


class StartReport(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """What a process does that has not come up yet."""

    process: Annotated[str, Meta(max_length=32)]
    stage: Annotated[str, Meta(max_length=LINE_CHARS)]
    fraction: Annotated[float, Meta(description="of the stage that is done, 0 to 1")]


class ReplayReport(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """A recording whose pictures are shown: seconds since its first frame."""

    file: Annotated[str, Meta(max_length=LINE_CHARS)]
    place_s: float
    length_s: float
    rate: float
    halted: bool
    loop: bool
    attempt: Annotated[Attempt | None, Meta(description="as it was told of at that time")] = None


class Judgement(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """What the supervisor finds and tells people, beside the state that processes obey; nobody acts on it."""

    incarnation: Annotated[int, Meta(ge=0, lt=1 << 53, description="of this run, which commands must name")]
    t: Annotated[float, Meta(description="the rig's time, since the supervisor's start")]
    broken: Annotated[tuple[str, ...], Meta(max_length=64, description="keys of contracts that are broken")] = ()
    path_limits_us: Annotated[dict[str, float], Meta(max_length=32, description="present limits of the paths")] = {}
    events: Annotated[tuple[Event, ...], Meta(max_length=EVENTS_TOLD, description="the newest, oldest first")] = ()
    start_notice: Annotated[str, Meta(max_length=LINE_CHARS, description="empty once the rig has started")] = ""
    starts: Annotated[tuple[StartReport, ...], Meta(max_length=16)] = ()
    replay: Annotated[ReplayReport | None, Meta(description="none in a working rig")] = None
