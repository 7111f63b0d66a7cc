"""Commands of people to the supervisor: executed while the sender waits, and answered with the outcome.

A deadline is in the rig's own time (`t`, seconds since its supervisor's start), which senders receive together with the
`incarnation` that it belongs to, so that no two clocks are compared.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

import msgspec

import trocar.protocol.bodies as bodies

if TYPE_CHECKING:
    from trocar.services.supervisor.control.supervisor import Supervisor

What = Literal["arm", "safe_stop", "attempt", "replay", "switch", "restart", "take_over"]
Reply = Callable[[bodies.Answer], object]
#: A command is answered this long before its sender gives up, whatever is known by then.
_EARLY_S = 0.6
#: Time for its outcome to be known: the gateway's next report but one comes within it.
_OUTCOME_S = 0.5


class Command(msgspec.Struct, frozen=True, kw_only=True):
    """A person's command to a run of the rig, with a deadline in its time.

    An `order` is for the attempt; a `line` is for the shown recording, or names the scenario to
    switch to, or the recording and tick to go on from. Without an
    `incarnation` it is for no run until its sender has learnt the present one (`command_socket.ask_rig`).
    """

    what: What
    who: str
    incarnation: int | None = None
    before_s: float = 0.0
    order: bodies.Order | None = None
    line: str = ""


class Commands:
    """Executes commands to a supervisor, and replies once their outcome is known."""

    def __init__(self, supervisor: Supervisor) -> None:
        self._rig = supervisor
        self._open: list[tuple[Command, float, Reply]] = []

    def take_command(
        self, command: Command, now_s: float, reply: Reply, may_begin: Callable[[], bool] = lambda: True
    ) -> None:
        """Execute a command, unless it is for another run of the rig or its outcome would be known too late.

        `may_begin` is asked last: it settles with the sender, for good, that the command is carried out.
        """
        late_s = now_s + _OUTCOME_S - self._answer_due_s(command)
        if command.incarnation != self._rig.incarnation:
            reply(_answer(False, "it was meant for another run of the rig: nothing was done"))
        elif not late_s <= 0.0:
            text = f"came {late_s:.1f} s too late to be confirmed to its sender: nothing was done"
            self._rig.say("warning", f"supervisor: {command.what} asked for by {command.who} {text}")
            reply(_answer(False, text))
        elif not may_begin():
            text = "was given up by its sender before it began: nothing was done"
            self._rig.say("warning", f"supervisor: {command.what} asked for by {command.who} {text}")
            reply(_answer(False, text))
        else:
            self._carry_out(command)
            self._open.append((command, now_s, reply))
            self.answer_finished(now_s)

    def answer_finished(self, now_s: float) -> None:
        """Answer commands that are done."""
        for each in tuple(self._open):
            command, asked_s, reply = each
            outcome = self._outcome(command, asked_s, ends=now_s > self._answer_due_s(command))
            if outcome is not None:
                self._open.remove(each)
                reply(outcome)

    def _answer_due_s(self, command: Command) -> float:
        """Return when a command is answered at the latest, which decides whether it is begun at all."""
        return self._rig.started_s + command.before_s - _EARLY_S

    def _carry_out(self, command: Command) -> None:
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
            case "restart":
                self._rig.restart(command.who)
            case "take_over":
                self._rig.take_over(command.line, command.who)

    def _outcome(self, command: Command, asked_s: float, ends: bool) -> bodies.Answer | None:
        """Return the outcome of a command, None while it is undecided."""
        if command.what in ("arm", "safe_stop"):
            return self._at_the_hands(command.what, asked_s, ends)
        if command.order is not None:
            return self._of_the_attempt(command.order, ends)
        begins = {"switch": command.line, "restart": "the rig", "take_over": "the moment"}.get(command.what)
        return _answer(True, f"{begins} begins: a few seconds." if begins else "done")

    def _at_the_hands(self, what: What, asked_s: float, ends: bool) -> bodies.Answer | None:
        done = "armed" if what == "arm" else "safe stop"
        gateway = self._rig.crew.members.get("gateway")
        if gateway is None or self._rig.crew.has_ended(gateway):
            return _answer(True, f"{done}, for the next gateway: none runs")
        said = gateway.safe_stop_said(asked_s)
        if said is not None and bool(said) is (what == "safe_stop"):
            return _answer(True, f"{done}: hands may be pushed" if what == "arm" else f"{done}: every hand is let go")
        if not ends:
            return None
        why = "has not said that it obeys" if gateway.health else "is not heard: whether it obeys is unknown"
        return _answer(False, f"{done}, but the gateway {why}")

    def _of_the_attempt(self, order: bodies.Order, ends: bool) -> bodies.Answer | None:
        if "training" not in self._rig.crew.members:
            return _answer(False, "this rig has no training process")
        answers = self._rig.attempt_answers()
        found = next((each for each in answers if each.order == order.id), None)
        return found or (
            _answer(False, "the training process did not answer: nothing is done any more") if ends else None
        )


def _answer(ok: bool, text: str) -> bodies.Answer:
    return bodies.Answer(order=0, ok=ok, text=text)
