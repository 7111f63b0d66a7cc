"""What people ask of the supervisor: carried out while they wait for it, and answered by what came of it.

A deadline is in the rig's own time (`t`, seconds since its supervisor's start), which who asks is told together with
the `incarnation` that it counts for: no two clocks are compared.
"""

from __future__ import annotations

import secrets
from collections import deque
from typing import TYPE_CHECKING, Literal

import msgspec

import protocol.bodies as bodies
from services.supervisor.member import MemberState

if TYPE_CHECKING:
    from services.supervisor.supervisor import Supervisor

What = Literal["arm", "safe_stop", "attempt", "replay", "switch", "beat"]
#: The gateway's report is made in pieces: one that comes sooner may be older than the command.
_REPORT_S = 0.2
#: So long before its sender gives up it is answered, whatever is known by then.
_EARLY_S = 0.6
#: Processes in these states move no hand.
_AWAY = (MemberState.WAITING, MemberState.LOST, MemberState.FAILED)


class Command(msgspec.Struct, frozen=True, kw_only=True):
    """What a person asks for: of which run of the rig, and up to when, in its time.

    An `order` is for the attempt, a `line` for the recording that is shown, or names the scenario to switch to. A page
    that lives beats, and its `line` is what is wrong with what it has started.
    """

    what: What
    who: str
    incarnation: int
    before_s: float
    id: int = msgspec.field(default_factory=lambda: secrets.randbits(53))
    order: bodies.Order | None = None
    line: str = ""


class Commands:
    """Carries out what is asked of a supervisor; `answers` are the last ones, by the command's id."""

    def __init__(self, supervisor: Supervisor) -> None:
        self.answers: deque[bodies.Answer] = deque(maxlen=16)
        self._rig = supervisor
        self._open: list[tuple[Command, float]] = []

    def take(self, command: Command, now_s: float) -> None:
        """Carry out a command, unless its sender has given it up or means another run of the rig."""
        late_s = now_s - self._rig.started_s - command.before_s
        if command.incarnation != self._rig.incarnation:
            self._answer(command, False, "it was meant for another run of the rig: nothing was done")
        elif not late_s <= 0.0:
            text = f"came {late_s:.1f} s after its sender had given it up: nothing was done"
            self._rig.say("warning", f"supervisor: {command.what} asked for by {command.who} {text}")
            self._answer(command, False, text)
        else:
            self._carry_out(command, now_s)

    def turn(self, now_s: float) -> None:
        """Answer what is done by now."""
        for each in tuple(self._open):
            command, asked_s = each
            ends = now_s - self._rig.started_s > command.before_s - _EARLY_S
            outcome = self._outcome(command.what, asked_s, ends)
            if outcome is not None:
                self._open.remove(each)
                self._answer(command, *outcome)

    def _carry_out(self, command: Command, now_s: float) -> None:
        match command.what:
            case "arm":
                self._rig.arm(command.who)
            case "safe_stop":
                self._rig.safe_stop(command.who)
            case "attempt" if command.order is not None:
                self._rig.order(command.order, command.before_s, command.who)
            case "replay" if self._rig.shown is not None:
                self._rig.shown.obey(command.line)
            case "switch":
                self._rig.switch(command.line, command.who)
        if command.what in ("arm", "safe_stop"):
            self._open.append((command, now_s))

    def _outcome(self, what: What, asked_s: float, ends: bool) -> tuple[bool, str] | None:
        """Return whether an arm or a safe stop has come to the hands, in which words; None as long as it may."""
        done = "armed" if what == "arm" else "safe stop"
        gateway = self._rig.crew.members.get("gateway")
        if gateway is None or gateway.state in _AWAY:
            return True, f"{done}: no gateway runs"
        health = gateway.health if gateway.heard_s >= asked_s + _REPORT_S else None
        said = health.gauges.get("safe_stop") if health is not None else None
        if said is not None and bool(said) is (what == "safe_stop"):
            return True, f"{done}: hands may be pushed" if what == "arm" else f"{done}: every hand is let go"
        return (False, f"{done}, but the gateway has not said that it obeys") if ends else None

    def _answer(self, command: Command, ok: bool, text: str) -> None:
        self.answers.append(bodies.Answer(order=command.id, ok=ok, text=text))
