"""The supervisor's command socket for command line and page, with the gateway as a fallback for a safe stop."""

from __future__ import annotations

import math
import socket
from contextlib import closing, suppress
from pathlib import Path
from typing import TypeVar

import msgspec

import trocar.protocol.bodies as bodies
from trocar.protocol.topics import HEARTBEAT_S, ORDER_S
from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.bus.claim import Claim
from trocar.services.runtime.bus.stop_line import stop_gateway
from trocar.services.runtime.config.rig import Transport
from trocar.services.runtime.errors import BusError
from trocar.services.supervisor.control.commands import Command
from trocar.services.supervisor.control.supervisor import Supervisor

#: Callers at once: the page, and a person's commands, which last a second. More are kept out, as each holds a
#: descriptor.
_PEERS = 8
_HELLO_S = 1.0  # the supervisor, which looks fifty times a second, answers with its first look
#: Timeout of a command, which is not executed afterwards: that of an order to the attempt, and five reports for the
#: answer.
ANSWER_S = ORDER_S + HEARTBEAT_S
#: More than the longest command: a moment and a name have some hundred characters.
_MESSAGE_MAX = 1 << 14
#: Time for an answer to a command that had been begun when its sender wanted to give up.
_BEGUN_S = 1.0


class RunTime(msgspec.Struct, frozen=True):
    """First message to a client: the run of the rig, and its time."""

    incarnation: int
    t: float


def control_path(transport: Transport) -> Path:
    """Return the path of the socket, in this user's private directory."""
    return endpoints.run_directory(transport) / "supervisor.control"


_T = TypeVar("_T", bound=msgspec.Struct)


class Link:
    """One end of a connection; only `wait` blocks."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end

    def send(self, message: msgspec.Struct) -> bool:
        """Send a message unless the other end is slow or gone; return whether it was sent."""
        try:
            self._end.send(msgspec.json.encode(message), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except OSError:  # also if this end is closed
            return False
        return True

    def receive_claimed(self, kind: type[_T]) -> tuple[_T, Claim | None] | None:
        """Return the next message with the claim that came with it, None without one.

        Raises ConnectionError if the other end is gone.
        """
        try:
            data, claim, _ = Claim.receive(self._end, _MESSAGE_MAX)
        except BlockingIOError:
            return None
        try:
            if not data:
                raise ConnectionResetError("the other end is gone")
            return msgspec.json.decode(data, type=kind), claim
        except BaseException:
            if claim is not None:
                claim.close()
            raise

    def send_claimed(self, message: msgspec.Struct, claim: Claim) -> None:
        """Send a message that is only carried out if its receiver can take the claim. Raises OSError."""
        claim.send_with(self._end, msgspec.json.encode(message))

    def wait(self, kind: type[_T], timeout_s: float) -> _T | None:
        """Return the next message, None without one within `timeout_s`; raises as `receive_claimed` does."""
        self._end.settimeout(timeout_s)
        try:
            data = self._end.recv(_MESSAGE_MAX)
        except TimeoutError:
            return None
        if not data:
            raise ConnectionResetError("the other end is gone")
        return msgspec.json.decode(data, type=kind)

    def close(self) -> None:
        """Close this end."""
        self._end.close()


class CommandSocket:
    """The supervisor's end of the socket; it never waits."""

    def __init__(self, supervisor: Supervisor) -> None:
        self._rig = supervisor
        self._path = control_path(supervisor.rig.transport)
        self._path.unlink(missing_ok=True)
        self._line = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        self._line.bind(str(self._path))
        self._line.listen(_PEERS)
        self._callers: dict[Link, bool] = {}  # whether it has sent a command

    def close(self) -> None:
        """Close the socket and all connections."""
        self._path.unlink(missing_ok=True)
        self._line.close()
        for caller in self._callers:
            caller.close()

    def run_turn(self, now_s: float) -> None:
        """Accept clients and process their commands."""
        with suppress(BlockingIOError):
            caller = Link(self._line.accept()[0])
            caller.send(RunTime(self._rig.incarnation, now_s - self._rig.started_s))
            self._callers[caller] = False
            if len(self._callers) > _PEERS:  # the longest silent one makes room
                self._drop(next(each for each, has_asked in self._callers.items() if not has_asked))
        for caller in tuple(self._callers):
            try:
                while (received := caller.receive_claimed(Command)) is not None:
                    self._callers[caller] = True
                    self._begin_command(*received, now_s, caller)
            except (ConnectionError, msgspec.DecodeError):
                self._drop(caller)

    def _begin_command(self, command: Command, claim: Claim | None, now_s: float, caller: Link) -> None:
        """Hand on a command that came with a claim; without one nobody could tell whether it was given up."""
        if claim is None:
            caller.send(bodies.Answer(order=0, ok=False, text="it came without a claim: nothing was done"))
            return
        with closing(claim):
            self._rig.commands.take_command(command, now_s, caller.send, claim.take_claim)

    def _drop(self, caller: Link) -> None:
        caller.close()
        del self._callers[caller]


def ask_rig(transport: Transport, command: Command, patience_s: float = ANSWER_S) -> bodies.Answer:
    """Send a command to the rig on this host and return the answer.

    A command without an incarnation is for the present run. If the supervisor does not execute a safe stop, it is sent
    to the gateway directly. Raises BusError if there is no supervisor, or it does not answer: nothing is done then,
    also later. What was begun is said to be.
    """
    try:
        answer = _ask_supervisor(transport, command, patience_s)
        why = "the supervisor does not answer" if answer is None else answer.text
    except OSError:
        answer, why = None, f"no supervisor is running here ({control_path(transport)}); name one with --address"
    if answer is not None and answer.ok:
        return answer
    if command.what == "safe_stop":
        let_go = stop_gateway(transport)
        if let_go:
            return bodies.Answer(order=0, ok=True, text=f"{why}: the gateway itself has let every hand go")
        if let_go is None:
            text = f"{why}: the gateway itself has begun to let every hand go, and has not confirmed it"
            return bodies.Answer(order=0, ok=False, text=text)
    if answer is None:
        raise BusError(f"{why}: nothing is done any more")
    return answer


def _ask_supervisor(transport: Transport, command: Command, patience_s: float) -> bodies.Answer | None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as end:
        end.settimeout(_HELLO_S)
        end.connect(str(control_path(transport)))
        link = Link(end)
        if (now := link.wait(RunTime, _HELLO_S)) is None:
            return None
        is_dated = command.incarnation is not None
        before_s = min(command.before_s if is_dated else math.inf, now.t + patience_s)
        incarnation = command.incarnation if is_dated else now.incarnation
        with closing(Claim.new()) as claim:
            link.send_claimed(msgspec.structs.replace(command, incarnation=incarnation, before_s=before_s), claim)
            return _await(link, claim, patience_s)


def _await(link: Link, claim: Claim, patience_s: float) -> bodies.Answer | None:
    """Return the answer to a command; None if the supervisor has not begun with it, and then never will."""
    with suppress(ConnectionError):
        if (answer := link.wait(bodies.Answer, patience_s)) is not None:
            return answer
    if claim.take_claim():
        return None
    with suppress(ConnectionError):  # it is at it
        if (answer := link.wait(bodies.Answer, _BEGUN_S)) is not None:
            return answer
    return bodies.Answer(order=0, ok=False, text="the supervisor has begun with it, and has not said what came of it")
