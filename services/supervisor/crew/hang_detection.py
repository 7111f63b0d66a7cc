"""Detection of processes that are silent or stopped by a signal, as pure functions of received reports.

A missing 1 kHz stream shows within tens of milliseconds; the kernel reports a stopped child at once; the heartbeat
covers all others.
"""

from __future__ import annotations

from dataclasses import dataclass

from trocar.protocol.topics import HEARTBEAT_S
from trocar.services.supervisor.crew.member import Member, MemberState

#: Silence of a 1 kHz stream that is a hang: longer than stalls of a busy machine, short enough to notice in 100 ms.
STREAM_SILENCE_S = 0.06
#: A process that recovers from this many silences within this time is overloaded: once or twice may be chance. On a
#: machine too slow for its scene they came more than once a second (seen in CI).
STALLS, STALLS_WITHIN_S = 3, 10.0
#: A wait for a processor of this length, since the process was last heard, is mentioned.
_STARVED_MS = 10
#: A process that waited for a processor for this share of its silence starves rather than hangs. (One with a hundredth
#: of a core for its first picture was once ended, and took a minute to return.)
_STARVES = 0.8
#: A process silent for this many heartbeat limits hangs, however busy the machine is, as one in an endless loop also
#: waits for a processor.
_MOST_LIMITS = 10.0
_LIVING = ("ready", "running", "degraded")


@dataclass(frozen=True, slots=True)
class HangLimits:
    """Accepted silences, in seconds."""

    heartbeat_s: float = HEARTBEAT_S
    stream_s: float = STREAM_SILENCE_S
    ready_s: float = 120.0


def says_living(member: Member) -> bool:
    """Return whether a process has reported that it is ready and works."""
    return member.health is not None and member.health.state in _LIVING


def may_be_silent(member: Member, now_s: float, limits: HangLimits) -> bool:
    """Return whether a living process was not heard for half of the accepted time."""
    if not says_living(member):
        return False
    stream_s = now_s if member.stream_s is None else member.stream_s
    return now_s - member.heard_s > 0.5 * limits.heartbeat_s or now_s - stream_s > 0.5 * limits.stream_s


def says_ready(member: Member, now_s: float, limits: HangLimits) -> bool:
    """Return whether a process reports ready and its stream is heard."""
    if not says_living(member) or now_s - member.heard_s > limits.heartbeat_s:
        return False
    if member.spec.stream is None:
        return True
    return member.stream_s is not None and now_s - member.stream_s <= limits.stream_s


def is_overdue(member: Member, now_s: float, limits: HangLimits) -> bool:
    """Return whether a starting process has made no progress for too long, not counting waits for a processor."""
    waited_s = member.child.waits().total_s - member.waited_before_s if member.child is not None else 0.0
    return now_s - max(member.since_s, member.advanced_s) - waited_s > limits.ready_s


def beyond_waiting(member: Member, stopped: bool, now_s: float, limits: HangLimits) -> bool:
    """Return whether a hung process is to be ended: stopped by a signal, or silent, for the heartbeat's limit.

    Waits for a processor do not count, and a process that waited for most of the time has ten times the limit: on a
    busy machine a process starves without hanging, and a restart would make it worse.
    """
    hung_s, silent_s, starved_s = now_s - member.since_s, now_s - member.heard_s, member.starved().total_s
    patience = _MOST_LIMITS if starved_s >= _STARVES * silent_s else 1.0
    hangs = silent_s - starved_s >= patience * limits.heartbeat_s
    return hung_s >= limits.heartbeat_s and (stopped or hangs)


def recent_stalls(member: Member, now_s: float) -> list[float]:
    """Return the ends of the silences that still count."""
    return [at_s for at_s in member.stalls_s if now_s - at_s <= STALLS_WITHIN_S]


def stalling(member: Member, now_s: float) -> str:
    """Return the message about a process with repeated silences, empty for none."""
    stalls = len(recent_stalls(member, now_s))
    return f"{member.name}: fell silent {stalls} times in {STALLS_WITHIN_S:.0f} s" if stalls >= STALLS else ""


def hang(member: Member, stopped: bool, now_s: float, limits: HangLimits) -> str:
    """Return the message about a hanging process, empty if it does not hang.

    A starting process may be silent (it builds a basis or compiles kernels), but not stopped. Waits for a processor do
    not count in the heartbeat's silence; in a stream's they do, as the hand feels it whatever the cause.
    """
    if stopped:
        known = member.state is MemberState.HUNG  # otherwise it was found stopped just now, at an unknown time
        held = f" for {(now_s - member.since_s) * 1e3:.0f} ms" if known else ""
        limit_ms = limits.heartbeat_s * 1e3
        return f"{member.name}: process {member.pid} is stopped by a signal{held}, limit {limit_ms:.0f} ms"
    if not says_living(member) or member.state not in (MemberState.READY, MemberState.HUNG):
        return ""
    if member.spec.stream is not None and member.stream_s is not None:
        stream_s = now_s - member.stream_s
        if stream_s > limits.stream_s:
            said = f"{member.spec.stream}: silent for {stream_s * 1e3:.0f} ms, limit {limits.stream_s * 1e3:.0f} ms"
            return said + _starved(member)
    silence_s = now_s - member.heard_s
    if silence_s > limits.heartbeat_s and silence_s - member.starved().total_s > limits.heartbeat_s:
        said = f"{member.name}.health: silent for {silence_s * 1e3:.0f} ms, limit {limits.heartbeat_s * 1e3:.0f} ms"
        return said + _starved(member)
    return ""


def _starved(member: Member) -> str:
    """Return a clause on the process' wait for a processor, empty if it was short."""
    starved = member.starved()
    if round(starved.total_s * 1e3) < _STARVED_MS:
        return ""
    waits = {"it": round(starved.loop_s * 1e3), "its bus": round(starved.bus_s * 1e3)}
    return "; " + " and ".join(f"{who} waited {ms} ms" for who, ms in waits.items() if ms) + " for a processor"
