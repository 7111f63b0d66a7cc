"""What the supervisor says to everyone."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta


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
