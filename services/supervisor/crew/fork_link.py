"""The supervisor's connection to the fork server, which forks processes with their imports done (`fork_server`).

The server is asked for a sign of life each second. One that is silent, stopped or gone is replaced. Until the new one
has imported, processes are started normally.
"""

from __future__ import annotations

import ctypes
import os
import select
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec

from trocar.services.runtime.private_directory import open_private
from trocar.services.supervisor.crew.fork_server import ALIVE, GO, ForkOrder
from trocar.services.supervisor.crew.processes import ENVIRONMENT
from trocar.services.supervisor.crew.restart_policy import MINUTE_S, helper_restarts
from trocar.services.supervisor.crew.silence import Silence

#: Timeouts of its imports, of a fork, and of a sign of life: the imports take 4 s on two quiet cores (measured), the
#: others milliseconds. A rig starts without it, too, so that patience only costs time.
_IMPORTS_S, _FORK_S, _SILENT_S = 30.0, 5.0, 5.0
#: As often as five signs of life may come until the last is missed.
_ASK_EVERY_S = 1.0
#: Padding for the command line of a forked process.
_ROOM = "x" * 2048
_PR_SET_CHILD_SUBREAPER = 36  # Linux: <linux/prctl.h>


@dataclass(frozen=True, slots=True)
class _Fork:
    """A fork that was ordered, and waits for permission to run."""

    order: ForkOrder
    link: socket.socket
    asked_s: float


class ForkServer:
    """A fork server, started again if it is lost."""

    def __init__(self) -> None:
        self._server: subprocess.Popen[bytes] | None = None
        self._fork: _Fork | None = None
        self._told: list[str] = []
        self._ask_s = self._retry_s = 0.0
        self.begin_server()

    def begin_server(self) -> None:
        """Start the server, if there is none."""
        self._is_wanted = True
        if self._server is None:
            self._starts, self._restarts = 0, helper_restarts()
            self._start()

    def _start(self) -> None:
        self._starts += 1
        self._link, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._link.setblocking(False)
        self._server = subprocess.Popen(
            [sys.executable, "-m", "trocar.services.supervisor.crew.fork_server", str(other.fileno()), _ROOM],
            # It inherits no descriptor of the caller, who may wait for the end of our output.
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            env={**os.environ, **ENVIRONMENT},
            pass_fds=(other.fileno(),),
            start_new_session=True,  # like its forks: a Ctrl-C at the terminal is for the supervisor
        )  # fmt: skip
        other.close()
        self._silence = Silence(self._server.pid, _IMPORTS_S)
        self._has_imported = False

    @property
    def pid(self) -> int:
        """Process id of the server, 0 if it has ended."""
        return self._server.pid if self._server is not None else 0

    @property
    def descriptor(self) -> int | None:
        """What becomes readable when the server has imported, or the ordered fork exists; None for neither."""
        if self._fork is not None:
            return self._fork.link.fileno()
        return None if self._server is None or self._has_imported else self._link.fileno()

    def tend_server(self) -> list[str]:
        """Look after the server, and replace one that was lost; return what there is to say. Never waits."""
        self._look()
        now_s = time.monotonic()
        if self._server is None:
            if self._is_wanted and now_s >= self._retry_s:
                self._start()
        elif not self._silence.awaits and now_s >= self._ask_s:
            self._ask_s = now_s + _ASK_EVERY_S
            self._silence.await_answer(_SILENT_S)
            with suppress(OSError):  # its end is noticed by the next look
                self._link.send(ALIVE)
        told, self._told = self._told, []
        return told

    def imports(self) -> bool:
        """Return whether the server is still importing; never waits."""
        self._look()
        return self._server is not None and not self._has_imported

    def _look(self) -> None:
        """Receive what the server says, and end it if it is gone or says nothing for too long."""
        if self._server is None:
            return
        while _is_readable(self._link):
            if not _receive(self._link):
                self._lose("has ended")
                return
            self._has_imported = True
            self._silence.awaits = False
        if wrong := self._silence.too_long():
            self._lose(wrong)

    def fork(self, module: str, arguments: Sequence[str], environment: Mapping[str, str], log_file: Path) -> int | None:
        """Return the process id of a fork that runs a module and writes into a file, 0 on failure; never waits.

        It is None while the server is busy: call it again then. One process is forked at a time. Only the imports of
        the first server are worth waiting for.
        """
        if self.imports():
            return None if self._starts == 1 else 0
        order = ForkOrder(module, tuple(arguments), dict(environment))
        if self._server is not None and self._fork is None:
            self._order(order, log_file)
        if self._fork is None:
            return 0
        return self._forked(self._fork) if self._fork.order == order else None

    def _order(self, order: ForkOrder, log_file: Path) -> None:
        mine, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        mine.setblocking(False)
        _adopt_orphans(True)
        self._fork = _Fork(order, mine, time.monotonic())
        sink = open_private(log_file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        try:
            socket.send_fds(self._link, [msgspec.json.encode(order)], [sink, its.fileno()])
        except OSError:
            self._lose("takes no order")
        finally:
            os.close(sink)
            its.close()

    def _forked(self, fork: _Fork) -> int | None:
        if not _is_readable(fork.link) and time.monotonic() - fork.asked_s <= _FORK_S:
            return None
        pid = int(_receive(fork.link) or 0)
        if pid:
            with suppress(OSError):  # it has ended since
                fork.link.send(GO)
        self.abandon()
        if not pid:
            self._lose("did not fork")
        return pid

    def abandon(self) -> None:
        """End the wait for a fork, which ends if it is not running yet."""
        if self._fork is not None:
            self._fork.link.close()
            self._fork = None
            _adopt_orphans(False)

    def close(self) -> None:
        """End the server; its forks continue."""
        self._is_wanted = False
        self._end()

    def _lose(self, why: str) -> None:
        now_s = time.monotonic()
        delay_s = self._restarts.delay_s(now_s)
        again = "for a minute processes import for themselves" if delay_s is None else "a new one is started"
        self._told.append(f"supervisor: the fork server (process {self.pid}) {why}: {again}")
        self._retry_s = now_s + (MINUTE_S if delay_s is None else delay_s)
        self._end()

    def _end(self) -> None:
        self.abandon()
        if self._server is None:
            return
        self._link.close()
        self._silence.close()
        self._server.kill()
        self._server.wait()
        self._server = None


def _is_readable(link: socket.socket) -> bool:
    return bool(select.select([link], [], [], 0.0)[0])


def _receive(link: socket.socket) -> bytes:
    try:
        return link.recv(64)
    except OSError:
        return b""


def _adopt_orphans(yes: bool) -> None:
    """Make this process adopt orphans of its children, such as the server's forks, instead of the system."""
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, int(yes), 0, 0, 0)
