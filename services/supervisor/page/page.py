"""The supervisor's handling of the page's process: start and restart.

The process is not real-time and shares no interpreter with the judging loop, so that it delays nothing when it is busy
or not run. It reads the bus as any observer.
"""

from __future__ import annotations

import hashlib
import socket
from pathlib import Path

from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew.processes import ProcessSpec
from trocar.services.supervisor.page.helper import Helper
from trocar.services.supervisor.page.page_place import PageFile, page_file, write_page_file

_PAGE = ProcessSpec("page", "trocar.services.supervisor.page.page_server")


class Page(Helper):
    """The page's process."""

    def __init__(self, sock: socket.socket, supervisor: Supervisor, content: PageFile, log_directory: Path) -> None:
        self._socket, self._file = sock, page_file(supervisor.rig.transport)
        log_file = log_directory / "page.log"
        super().__init__(_PAGE, log_file, supervisor.say, self._file, (sock.fileno(),), beats=True)
        write_page_file(self._file, content)
        supervisor.token_sha256 = hashlib.sha256(content.token.encode()).hexdigest()
        supervisor.page_address = f"{content.address}#token={content.token}"
        self.start()

    def close(self) -> None:
        """End the process, and release the address."""
        super().close()
        self._socket.close()
        self._file.unlink(missing_ok=True)
