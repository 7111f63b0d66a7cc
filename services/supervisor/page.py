"""The web page of a running supervisor, as the supervisor keeps it; without its packages, an onlooker in its place."""

from __future__ import annotations

import hashlib
import importlib.util
import secrets
import socket
from pathlib import Path
from types import TracebackType
from typing import Self

from services.supervisor.companion import Companion
from services.supervisor.notes import Opening
from services.supervisor.page_place import page_file, write_page_file
from services.supervisor.processes import ProcessSpec
from services.supervisor.supervisor import Supervisor

#: What the page's process needs beyond the rest of the rig.
PACKAGES = ("uvicorn", "starlette", "prometheus_client")
_PAGE = ProcessSpec("page", "services.supervisor.page_server")
_ONLOOKER = ProcessSpec("onlooker", "services.supervisor.onlooker")


def missing_package() -> str:
    """Return a package that the page needs and that is not installed, empty for none."""
    return next((name for name in PACKAGES if importlib.util.find_spec(name) is None), "")


def onlooker(supervisor: Supervisor, scene: str, log_directory: Path) -> Companion:
    """Return who keeps the flights of missed ticks where there is no page."""
    opening = Opening(supervisor.rig.model_dump_json(), scene, "")
    return Companion(supervisor, _ONLOOKER, opening, log_directory / "onlooker.log")


class Page(Companion):
    """Serves while it is open."""

    def __init__(self, sock: socket.socket, supervisor: Supervisor, scene: str, log_directory: Path) -> None:
        opening = Opening(supervisor.rig.model_dump_json(), scene, secrets.token_urlsafe(16))
        super().__init__(supervisor, _PAGE, opening, log_directory / "page.log", (sock.fileno(),))
        self._socket = sock
        host, port = sock.getsockname()[:2]
        host = "127.0.0.1" if host == "0.0.0.0" else "[::1]" if host == "::" else host
        self.address = f"http://{host}:{port}/"
        self._file = page_file(supervisor.rig.transport)

    def __enter__(self) -> Self:
        token = self._opening.token
        write_page_file(self._file, self.address, token)
        self._supervisor.token_sha256 = hashlib.sha256(token.encode()).hexdigest()
        self._supervisor.page_address = f"{self.address}#token={token}"
        return super().__enter__()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)
        self._socket.close()
        self._file.unlink(missing_ok=True)
