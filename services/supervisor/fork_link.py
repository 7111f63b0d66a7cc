"""The supervisor's connection to the fork server, which forks processes with their imports done (`fork_server`).

It is used only while the rig starts; restarted processes import for themselves. Without an answering server processes
are started normally.
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

import msgspec

from services.supervisor.fork_server import ForkOrder
from services.supervisor.processes import ENVIRONMENT

#: Timeouts of its imports and of a fork on a busy machine.
_IMPORTS_S, _FORK_S = 30.0, 5.0
#: Padding for the command line of a forked process.
_ROOM = "x" * 2048
_PR_SET_CHILD_SUBREAPER = 36


class ForkServer:
    """A fork server."""

    def __init__(self) -> None:
        self._server: subprocess.Popen[bytes] | None = None
        self.begin()

    def begin(self) -> None:
        """Start the server, if there is none."""
        if self._server is not None:
            return
        self._link, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._link.settimeout(_FORK_S)
        self._server = subprocess.Popen(
            [sys.executable, "-m", "services.supervisor.fork_server", str(other.fileno()), _ROOM],
            # It inherits no descriptor of the caller, who may wait for the end of our output.
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            env={**os.environ, **ENVIRONMENT},
            pass_fds=(other.fileno(),),
            start_new_session=True,  # like its forks: a Ctrl-C at the terminal is for the supervisor
        )  # fmt: skip
        other.close()
        self._began_s = time.monotonic()
        self._has_imported = False
        _adopt_orphans(True)

    @property
    def pid(self) -> int:
        """Process id of the server, 0 if it has ended."""
        return self._server.pid if self._server is not None else 0

    def imports(self) -> bool:
        """Return whether the server is still importing; never waits."""
        if self._server is None or self._has_imported:
            return False
        if select.select([self._link], [], [], 0.0)[0]:
            self._has_imported = True
            if not self._receive():
                self.close()
        elif time.monotonic() - self._began_s > _IMPORTS_S:
            self.close()
        return self._server is not None and not self._has_imported

    def fork(self, module: str, arguments: Sequence[str], environment: Mapping[str, str], sink: int) -> int:
        """Fork a child that runs a module and writes into `sink`; return its process id, 0 on failure."""
        if self._server is None or self.imports():
            return 0
        order = msgspec.json.encode(ForkOrder(module, tuple(arguments), dict(environment)))
        with suppress(OSError):
            socket.send_fds(self._link, [order], [sink])
            if pid := int(self._receive() or 0):
                return pid
        self.close()
        return 0

    def _receive(self) -> bytes:
        try:
            return self._link.recv(64)
        except OSError:
            return b""

    def close(self) -> None:
        """End the server; its forks continue."""
        if self._server is None:
            return
        self._link.close()
        self._server.kill()
        self._server.wait()
        self._server = None
        _adopt_orphans(False)


def _adopt_orphans(yes: bool) -> None:
    """Make this process adopt orphans of its children, such as the server's forks, instead of the system."""
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, int(yes), 0, 0, 0)
