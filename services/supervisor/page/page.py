"""The supervisor's handling of the page's process: start, messages, restart.

The process is not real-time and shares no interpreter with the judging loop, so that it delays nothing when it is busy
or not run. It reads the bus as any observer, and ends with its socket pair.
"""

from __future__ import annotations

import hashlib
import socket
from pathlib import Path

from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew.processes import ProcessSpec
from trocar.services.supervisor.page.linked_process import LinkedProcess
from trocar.services.supervisor.page.page_link import PageSetup
from trocar.services.supervisor.page.page_place import page_file, write_page_file

_PAGE = ProcessSpec("page", "trocar.services.supervisor.page.page_server")


class Page:
    """The page's process."""

    def __init__(self, sock: socket.socket, supervisor: Supervisor, setup: PageSetup, log_directory: Path) -> None:
        self._socket = sock
        self._file = page_file(supervisor.rig.transport)
        self._process = LinkedProcess(
            _PAGE, log_directory / "page.log", setup, supervisor.say, (sock.fileno(),), beats=True
        )
        address, token = _address(sock, "https" if setup.fingerprint else "http"), setup.token
        write_page_file(self._file, address, token, setup.fingerprint)
        supervisor.token_sha256 = hashlib.sha256(token.encode()).hexdigest()
        supervisor.page_address = f"{address}#token={token}"
        self._process.start()

    def end(self) -> None:
        """Let the process end, without waiting for it."""
        self._process.end()

    def close(self) -> None:
        """End the process, and release the address."""
        self._process.close()
        self._socket.close()
        self._file.unlink(missing_ok=True)

    def run_turn(self, now_s: float) -> None:
        """Keep the process running."""
        self._process.run_turn(now_s)


def _address(sock: socket.socket, scheme: str) -> str:
    host, port = sock.getsockname()[:2]
    host = "127.0.0.1" if host == "0.0.0.0" else "[::1]" if host == "::" else host
    return f"{scheme}://{host}:{port}/"
