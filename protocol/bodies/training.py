"""What the training process says: the attempt that is being made, and how fast the rig's time shall go meanwhile."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta


class Answer(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """The result of an order."""

    order: Annotated[int, Meta(ge=0, description="its id")]
    ok: bool
    text: Annotated[str, Meta(max_length=256)] = ""


class Attempt(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """One attempt at a scenario. Times are simulated, from the first motion on."""

    begins: Annotated[
        int, Meta(ge=0, description="how often the scene was restarted; if it grows, the gateway restarts")
    ]
    pace: Annotated[float, Meta(ge=0.0, le=1.0, description="of the rig's time: 0 paused, 1 as the clock")] = 1.0
    steps: Annotated[int, Meta(ge=0, description="single ticks asked for while paused, since the start")] = 0
    attempt_id: Annotated[str, Meta(max_length=64)] = ""
    state: Annotated[str, Meta(max_length=16, description="armed, running, done or abandoned")] = "armed"
    outcome: Annotated[str, Meta(max_length=16, description="success or failure, empty before the end")] = ""
    reason: Annotated[str, Meta(max_length=256)] = ""
    scenario: Annotated[str, Meta(max_length=64)] = ""
    title: Annotated[str, Meta(max_length=128)] = ""
    began_tick: Annotated[int, Meta(ge=-1, description="at which the scene began, -1 not yet")] = -1
    time_s: Annotated[float, Meta(ge=0.0, description="since the first motion")] = 0.0
    time_limit_s: float = 0.0
    phase: Annotated[str, Meta(max_length=8, description="P0 to P7")] = ""
    depth_m: Annotated[float, Meta(description="inside the lumen")] = 0.0
    goal_depth_m: Annotated[float, Meta(description="0: the scenario has no goal")] = 0.0
    depth_max_m: float = 0.0
    force_limit_n: Annotated[float, Meta(description="of a tool on the duct, 0 none")] = 0.0
    errors: Annotated[dict[str, int], Meta(max_length=32, description="number of each code, E1 to E14")] = {}
    counts: Annotated[bool, Meta(description="false: it is not scored, `why_not` says why")] = True
    why_not: Annotated[str, Meta(max_length=256)] = ""
    held: Annotated[tuple[str, ...], Meta(max_length=8, description="by instrument: catheter, duct or nothing")] = ()
    hint: Annotated[str, Meta(max_length=256)] = ""
    mirrored: bool = False
    one_handed: bool = False
    bookmarks_s: Annotated[tuple[float, ...], Meta(max_length=64)] = ()
    answers: Annotated[tuple[Answer, ...], Meta(max_length=8, description="to the last orders")] = ()
    score: Annotated[float, Meta(description="total of an attempt that is done, in s; -1: none")] = -1.0
    from_tick: Annotated[int, Meta(ge=-1, description="first tick that is judged, -1 none yet")] = -1
    until_tick: Annotated[int, Meta(ge=-1, description="last tick judged so far, -1 none yet")] = -1
    simulated_time: Annotated[bool, Meta(description="late ticks slow the rig's time down, and none is lost")] = False
    speed: Annotated[float, Meta(ge=0.0, description="of the rig's time against the clock, over some seconds")] = 1.0
    practice_only: Annotated[
        str, Meta(max_length=256, description="why an attempt would not count now, and what to do; empty: it would")
    ] = ""
    examined: Annotated[bool, Meta(description="no hint is given, and no error told before the end")] = False
