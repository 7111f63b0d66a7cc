"""The supervisor's own line: who runs the rig commands it there without a page."""

from __future__ import annotations

import socket
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

import protocol.bodies as bodies
from services.runtime import endpoints
from services.runtime.rig import Transport
from services.supervisor.commands import Command, What
from services.supervisor.page_link import Link
from services.supervisor.supervisor import Supervisor

_PEERS = 8
_HELLO_S = 1.0


class RigTime(msgspec.Struct, frozen=True):
    """What a caller is told first: which run of the rig this is, and its time."""

    incarnation: int
    t: float


def control_path(transport: Transport) -> Path:
    """Return the path of the line, in the directory that is this user's alone."""
    return endpoints.run_directory(transport) / "supervisor.control"


class Control:
    """The supervisor's end, while it is open. Nothing in it waits."""

    def __init__(self, supervisor: Supervisor) -> None:
        self._rig = supervisor
        self._path = control_path(supervisor.rig.transport)
        self._path.unlink(missing_ok=True)
        self._line = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        self._line.bind(str(self._path))
        self._line.listen(_PEERS)
        self._asked: dict[Link, set[int]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._path.unlink(missing_ok=True)
        self._line.close()
        for link in self._asked:
            link.close()

    def turn(self, now_s: float) -> None:
        """Greet who calls, pass on what they ask for, and answer."""
        if len(self._asked) < _PEERS:
            with suppress(BlockingIOError):
                link = Link(self._line.accept()[0])
                link.send(RigTime(self._rig.incarnation, now_s - self._rig.started_s))
                self._asked[link] = set()
        for link in tuple(self._asked):
            try:
                self._serve(link, self._asked[link], now_s)
            except (ConnectionError, msgspec.DecodeError):
                link.close()
                del self._asked[link]

    def _serve(self, link: Link, asked: set[int], now_s: float) -> None:
        while (command := link.receive(Command)) is not None:
            asked.add(command.id)
            self._rig.commands.take(command, now_s)
        for answer in self._rig.commands.answers:
            if answer.order in asked and link.send(answer):
                asked.remove(answer.order)


def ask(transport: Transport, what: What, who: str, patience_s: float) -> bodies.Answer | None:
    """Return what came of an arm or a safe stop, None where the supervisor does not answer.

    Raises
    ------
    OSError
        if no supervisor is there, or it ends.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as end:
        end.settimeout(_HELLO_S)
        end.connect(str(control_path(transport)))
        link = Link(end)
        if (now := link.wait(RigTime, _HELLO_S)) is None:
            return None
        link.send(Command(what=what, who=who, incarnation=now.incarnation, before_s=now.t + patience_s))
        return link.wait(bodies.Answer, patience_s)
