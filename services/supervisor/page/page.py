"""The supervisor's handling of the page's process: start, messages, restart.

The process is not real-time and shares no interpreter with the judging loop, so that it delays nothing when it is busy
or not run. It receives the processes' reports itself, and ends with its socket pair.
"""

from __future__ import annotations

import hashlib
import socket
from pathlib import Path

from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew.processes import ProcessSpec
from trocar.services.supervisor.crew.silence import Silence
from trocar.services.supervisor.page.linked_process import LinkedProcess
from trocar.services.supervisor.page.page_link import STATUS_S, Heartbeat, PageSetup, RigStatus
from trocar.services.supervisor.page.page_place import page_file, write_page_file

_PAGE = ProcessSpec("page", "trocar.services.supervisor.page.page_server")
#: Silence that is a hang, of a running and of a starting page, not counting waits for a processor.
SILENT_S, _SILENT_AT_FIRST_S = 5.0, 60.0


class Page:
    """The page's process."""

    def __init__(self, sock: socket.socket, supervisor: Supervisor, setup: PageSetup, log_directory: Path) -> None:
        self._supervisor = supervisor
        self._socket = sock
        self._setup = setup
        self._file = page_file(supervisor.rig.transport)
        self._process = LinkedProcess(_PAGE, log_directory / "page.log")
        self._due_s = 0.0
        address, token = _address(sock, "https" if setup.fingerprint else "http"), setup.token
        write_page_file(self._file, address, token, setup.fingerprint)
        supervisor.token_sha256 = hashlib.sha256(token.encode()).hexdigest()
        supervisor.page_address = f"{address}#token={token}"
        self._start()

    def end(self) -> None:
        """Let the process end, without waiting for it."""
        self._process.end()

    def close(self) -> None:
        """End the process, and release the address."""
        lived = self._process.child is not None
        self._process.close()
        if lived:
            self._silence.close()
        self._socket.close()
        self._file.unlink(missing_ok=True)

    def run_turn(self, now_s: float) -> None:
        """Send the status when due; restart the process if it ended or hangs."""
        link = self._process.link
        if link is None:
            if now_s >= self._process.due_s:
                self._start()
            return
        try:
            while link.receive(Heartbeat) is not None:
                self._silence.await_answer(SILENT_S)
        except ConnectionError:
            self._lose(now_s)
            return
        if why := self._silence.too_long():
            self._lose(now_s, f"{why} and")
            return
        if now_s >= self._due_s:
            self._due_s = now_s + STATUS_S
            link.send(RigStatus.of(self._supervisor, now_s))

    def _start(self) -> None:
        child = self._process.start(self._setup, [self._socket.fileno()])
        self._silence = Silence(child.pid, _SILENT_AT_FIRST_S)

    def _lose(self, now_s: float, why: str = "") -> None:
        status, is_soon = self._process.lose(now_s)
        self._silence.close()
        again = "started again" if is_soon else "the rig goes on without for a minute"
        what = " ".join(filter(None, ("the page's process", why, f"ended with exit code {status}")))
        text = f"supervisor: {what}, {again}"
        self._supervisor.say("warning", f"{text} (see {self._process.log_file})")


def _address(sock: socket.socket, scheme: str) -> str:
    host, port = sock.getsockname()[:2]
    host = "127.0.0.1" if host == "0.0.0.0" else "[::1]" if host == "::" else host
    return f"{scheme}://{host}:{port}/"
