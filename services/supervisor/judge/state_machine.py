"""States of the rig and their transitions, as a pure function of facts."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class RigState(StrEnum):
    """States of the rig."""

    OFF = "off"
    STARTING = "starting"
    READY = "ready"
    RUNNING = "running"
    DEGRADED = "degraded"
    SAFE_STOP = "safe_stop"


@dataclass(frozen=True, slots=True)
class RigFacts:
    """Facts that decide on the state.

    Args:
        all_ready: Every awaited process is ready.
        trouble: Something is lost, hung, or breaks its contract.
        settled: `all_ready` has held for the settling time.
        calm: There was no `trouble` for the settling time.
        safe_stop: A safe stop is in force, by command or as the last resort. Only arming the rig clears it.
        stalling: All have been ready, but some repeatedly fall silent: the machine is too slow for the scene, and will
            not settle.
    """

    all_ready: bool = False
    trouble: bool = False
    settled: bool = False
    calm: bool = False
    safe_stop: bool = False
    stalling: bool = False


def next_state(state: RigState, now: RigFacts) -> RigState:
    """Return the state that follows `state`.

    A safe stop overrides everything. It is left only through STARTING, so a rig that is armed again passes READY. READY
    becomes RUNNING when it has settled; contracts are judged from then on. A rig that cannot settle is DEGRADED, where
    enforcement may still help.
    """
    if now.safe_stop:
        return RigState.SAFE_STOP
    match state:
        case RigState.OFF | RigState.SAFE_STOP:
            return RigState.STARTING
        case RigState.STARTING:
            return RigState.READY if now.all_ready or now.stalling else state
        case RigState.READY:
            if not now.all_ready:
                return RigState.DEGRADED if now.stalling else RigState.STARTING
            return RigState.RUNNING if now.settled else state
        case RigState.RUNNING:
            return RigState.DEGRADED if now.trouble or not now.all_ready else state
        case RigState.DEGRADED:
            return RigState.RUNNING if now.settled and now.calm else state
