"""The gateway's stop socket: any message removes all forces, without a page or a supervisor.

A message that comes with a claim (`claim`) does so only if its sender has not given up on it.
"""

from __future__ import annotations

import socket
from contextlib import closing, suppress
from pathlib import Path

from trocar.protocol.topics import HEARTBEAT_S
from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.bus.claim import Claim
from trocar.services.runtime.config.rig import Transport

#: A gateway looks here every tick, and one that has not for twice the heartbeat's limit hangs: its drives let go then.
_PATIENCE_S = 2 * HEARTBEAT_S


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
        while True:
            try:
                _, claim, sender = Claim.receive(self._line, 1)
            except BlockingIOError:
                return False
            if claim is not None:
                with closing(claim):
                    if not claim.take_claim():
                        continue
            with suppress(OSError, TypeError):  # a sender in another container, or without an address
                self._line.sendto(b"done", sender)
            return True

    def close(self) -> None:
        """Close the socket."""
        self._line.close()


def stop_gateway(transport: Transport) -> bool | None:
    """Remove all forces of the rig on this host; return whether its gateway confirms it.

    None if the gateway has begun and not confirmed it. If it has not begun it never will.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line, closing(Claim.new()) as claim:
        line.bind("")  # an automatic address, for the answer
        line.settimeout(_PATIENCE_S)
        try:
            line.connect(str(stop_path(transport)))
            claim.send_with(line, b"")
            return bool(line.recv(4))
        except TimeoutError:
            if claim.take_claim():
                return False
        except OSError:
            return False
        with suppress(OSError):
            return bool(line.recv(4))
        return None
