"""The gateway's stop socket: any message removes all forces, without a page or a supervisor."""

from __future__ import annotations

import socket
from contextlib import suppress
from pathlib import Path

from trocar.services.runtime import endpoints
from trocar.services.runtime.rig import Transport

_PATIENCE_S = 1.0


def stop_path(transport: Transport) -> Path:
    """Return the path of the socket, in this user's private directory."""
    return endpoints.run_directory(transport) / "gateway.stop"


class StopLine:
    """The gateway's end, opened by the process that holds the lock of the gateway's topics."""

    def __init__(self, transport: Transport) -> None:
        path = stop_path(transport)
        path.unlink(missing_ok=True)
        self._line = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._line.bind(str(path))

    def is_asked(self) -> bool:
        """Return whether a stop was requested since the last call, and confirm it to one sender."""
        try:
            _, sender = self._line.recvfrom(1)
        except BlockingIOError:
            return False
        with suppress(OSError, TypeError):  # a sender in another container, or without an address
            self._line.sendto(b"done", sender)
        return True

    def close(self) -> None:
        """Close the socket."""
        self._line.close()


def stop_gateway(transport: Transport) -> bool:
    """Remove all forces of the rig on this host; return whether its gateway confirms it."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
        line.bind("")  # an automatic address, for the answer
        line.settimeout(_PATIENCE_S)
        try:
            line.sendto(b"", str(stop_path(transport)))
            return bool(line.recv(4))
        except OSError:
            return False
