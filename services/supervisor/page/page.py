"""The supervisor's handling of the page's process: start, messages, restart.

The process is not real-time and shares no interpreter with the judging loop, so that it delays nothing when it is busy
or not run. It receives the processes' reports itself, and ends with its socket pair.
"""

from __future__ import annotations

import hashlib
import socket
from pathlib import Path

from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew.launcher import Child
from trocar.services.supervisor.crew.processes import ProcessSpec
from trocar.services.supervisor.crew.restart_policy import MINUTE_S, RestartPolicy
from trocar.services.supervisor.crew.silence import Silence
from trocar.services.supervisor.page.page_link import Heartbeat, Link, PageSetup, RigStatus
from trocar.services.supervisor.page.page_place import page_file, write_page_file

_PAGE = ProcessSpec("page", "trocar.services.supervisor.page.page_server")
_TELL_S = 0.2
#: Delay of a restart, and the number of them in a minute.
_RETRY_S, _RETRIES = 2.0, 5
_END_S = 3.0
#: Silence that is a hang, of a running and of a starting page, not counting waits for a processor.
_SILENT_S, _SILENT_AT_FIRST_S = 5.0, 60.0


class Page:
    """The page's process."""

    def __init__(self, sock: socket.socket, supervisor: Supervisor, setup: PageSetup, log_directory: Path) -> None:
        self._supervisor = supervisor
        self._socket = sock
        self._setup = setup
        self._log_file = log_directory / "page.log"
        self._file = page_file(supervisor.rig.transport)
        self._child: Child | None = None
        self._link: Link | None = None
        self._restarts = RestartPolicy((_RETRY_S,), _RETRIES)
        self._due_s = self._retry_s = 0.0
        address, token = _address(sock, "https" if setup.fingerprint else "http"), setup.token
        write_page_file(self._file, address, token, setup.fingerprint)
        supervisor.token_sha256 = hashlib.sha256(token.encode()).hexdigest()
        supervisor.page_address = f"{address}#token={token}"
        self._start(supervisor.started_s)

    def end(self) -> None:
        """Let the process end, without waiting for it."""
        if self._link is not None:
            self._link.close()

    def close(self) -> None:
        """End the process, and release the address."""
        self.end()
        if self._child is not None:
            self._child.wait(_END_S)
            self._child.kill()
            self._child.close()
            self._silence.close()
        self._socket.close()
        self._file.unlink(missing_ok=True)

    def turn(self, now_s: float) -> None:
        """Send the status when due; restart the process if it ended or hangs."""
        if self._link is None or self._child is None:
            if now_s >= self._retry_s:
                self._start(now_s)
            return
        try:
            while self._link.receive(Heartbeat) is not None:
                self._silence.begin(_SILENT_S)
        except ConnectionError:
            self._lost(self._link, self._child, now_s)
            return
        if why := self._silence.too_long():
            self._lost(self._link, self._child, now_s, f"{why} and")
            return
        if now_s >= self._due_s:
            self._due_s = now_s + _TELL_S
            self._link.send(RigStatus.of(self._supervisor, now_s))

    def _start(self, now_s: float) -> None:
        self._link, other = Link.pair()
        self._link.send(self._setup)
        descriptors = other.fileno(), self._socket.fileno()
        self._child = Child(_PAGE, [str(each) for each in descriptors], self._log_file, descriptors)
        self._silence = Silence(self._child.pid, _SILENT_AT_FIRST_S)
        other.close()

    def _lost(self, link: Link, child: Child, now_s: float, why: str = "") -> None:
        link.close()
        status = child.kill()
        child.close()
        self._silence.close()
        self._child = self._link = None
        delay_s = self._restarts.delay_s(now_s)
        self._retry_s = now_s + (MINUTE_S if delay_s is None else delay_s)
        again = "the rig goes on without for a minute" if delay_s is None else "started again"
        what = " ".join(filter(None, ("the page's process", why, f"ended with exit code {status}")))
        text = f"supervisor: {what}, {again}"
        self._supervisor.say("warning", f"{text} (see {self._log_file})")


def _address(sock: socket.socket, scheme: str) -> str:
    host, port = sock.getsockname()[:2]
    host = "127.0.0.1" if host == "0.0.0.0" else "[::1]" if host == "::" else host
    return f"{scheme}://{host}:{port}/"
