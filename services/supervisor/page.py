"""The web page of a running supervisor, as the supervisor keeps it: a process of the ordinary class.

It shares no interpreter with the loop that judges: a page that is not run, or is busy with a slow browser, holds up
nobody. It hears the processes for itself; what the supervisor makes of them it is told.
"""

from __future__ import annotations

import hashlib
import importlib.util
import secrets
import socket
from pathlib import Path
from types import TracebackType
from typing import Self

from services.supervisor.launcher import Child
from services.supervisor.notes import Command, Link, Opening, notes
from services.supervisor.page_place import page_file, write_page_file
from services.supervisor.processes import ProcessSpec
from services.supervisor.supervisor import Supervisor

#: What the page's process needs beyond the rest of the rig.
PACKAGES = ("uvicorn", "starlette", "prometheus_client")
_TELL_S = 0.2
#: A page that ended is started again after so long, so often.
_RETRY_S, _RETRIES = 2.0, 5
_END_S = 3.0
_SPEC = ProcessSpec("page", "services.supervisor.page_server")


def missing_package() -> str:
    """Return a package that the page needs and that is not installed, empty for none."""
    return next((name for name in PACKAGES if importlib.util.find_spec(name) is None), "")


class Page:
    """Serves while it is open."""

    def __init__(self, sock: socket.socket, supervisor: Supervisor, scene: str, log_file: Path) -> None:
        self._supervisor = supervisor
        self._socket = sock
        self._log_file = log_file
        self._opening = Opening(supervisor.rig.model_dump_json(), scene, secrets.token_urlsafe(16))
        host, port = sock.getsockname()[:2]
        host = "127.0.0.1" if host == "0.0.0.0" else "[::1]" if host == "::" else host
        self.address = f"http://{host}:{port}/"
        self._file = page_file(supervisor.rig.transport)
        self._child: Child | None = None
        self._link: Link | None = None
        self._starts = 0
        self._due_s = self._retry_s = 0.0

    def __enter__(self) -> Self:
        write_page_file(self._file, self.address, self._opening.token)
        self._supervisor.token_sha256 = hashlib.sha256(self._opening.token.encode()).hexdigest()
        self._supervisor.page_address = f"{self.address}#token={self._opening.token}"
        self._start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._link is not None:
            self._link.close()  # which it sees, and ends
        if self._child is not None:
            self._child.wait(_END_S)
            self._child.kill()
            self._child.close()
        self._socket.close()
        self._file.unlink(missing_ok=True)

    def turn(self, now_s: float) -> None:
        """Tell the page what there is to tell, do what it asks, start it again where it ended."""
        if self._link is None or self._child is None:
            if now_s >= self._retry_s and self._starts <= _RETRIES:
                self._start()
            return
        try:
            self._obey(self._link)
        except ConnectionError:
            self._lost(now_s)
            return
        if now_s >= self._due_s:
            self._due_s = now_s + _TELL_S
            self._link.send(notes(self._supervisor, now_s))

    def _obey(self, link: Link) -> None:
        while (command := link.receive(Command)) is not None:
            act = self._supervisor.arm if command.what == "arm" else self._supervisor.safe_stop
            act(command.who)

    def _start(self) -> None:
        self._starts += 1
        self._link, other = Link.pair()
        self._link.send(self._opening)
        descriptors = (other.fileno(), self._socket.fileno())
        self._child = Child(_SPEC, [str(each) for each in descriptors], self._log_file, descriptors)
        other.close()

    def _lost(self, now_s: float) -> None:
        assert self._child is not None
        assert self._link is not None
        self._link.close()
        status = self._child.kill()
        self._child.close()
        self._child = self._link = None
        self._retry_s = now_s + _RETRY_S
        again = "started again" if self._starts <= _RETRIES else "given up; the rig goes on without"
        text = f"supervisor: the page's process ended with exit code {status}, {again} (see {self._log_file})"
        self._supervisor.say("warning", text)
