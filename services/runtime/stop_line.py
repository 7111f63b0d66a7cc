"""The gateway's own line: whatever comes there lets every hand go. It needs neither a page nor a supervisor."""

from __future__ import annotations

import socket
from contextlib import suppress
from pathlib import Path

from services.runtime import endpoints
from services.runtime.rig import Transport

_PATIENCE_S = 1.0


def _path(transport: Transport) -> Path:
    return endpoints.run_directory(transport) / "gateway.stop"


class StopLine:
    """The gateway's end. Whoever holds the lock of the gateway's topics may open it."""

    def __init__(self, transport: Transport) -> None:
        path = _path(transport)
        path.unlink(missing_ok=True)
        self._line = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._line.bind(str(path))

    def is_asked(self) -> bool:
        """Return whether somebody has asked since the last call, and tell one of them that it is done."""
        try:
            _, sender = self._line.recvfrom(1)
        except BlockingIOError:
            return False
        with suppress(OSError, TypeError):  # of another container, or without a name
            self._line.sendto(b"done", sender)
        return True

    def close(self) -> None:
        """Listen no more."""
        self._line.close()


def stop_gateway(transport: Transport) -> bool:
    """Let every hand of the rig on this host go; return whether its gateway says that it has."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
        line.bind("")  # a name of the system's choice, for the answer
        line.settimeout(_PATIENCE_S)
        try:
            line.sendto(b"", str(_path(transport)))
            return bool(line.recv(4))
        except OSError:
            return False
