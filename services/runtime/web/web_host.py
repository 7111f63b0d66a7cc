"""Common parts of the rig's web servers: binding a socket, and checking the Host header."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Awaitable, Callable
from typing import Any
from urllib.parse import urlsplit

from trocar.services.runtime.errors import BusError


def host_of(header: str | None) -> str:
    """Return the host name in a Host header, without port and brackets; empty if invalid."""
    try:
        return urlsplit(f"//{header or ''}").hostname or ""
    except ValueError:
        return ""


def is_this_host(name: str) -> bool:
    """Return whether a name is certainly this host's: loopback, its own, or an address, which cannot be rebound.

    Any other may be another site's name that resolves to this host.
    """
    if name in ("localhost", socket.gethostname().lower()) or name.endswith(".localhost"):
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


class KnownHost:
    """ASGI middleware that rejects requests with another site's Host header (DNS rebinding).

    It passes scope, receive and send on to the wrapped application.
    """

    _WORDS = b"this name is not known here: use localhost or an address"

    def __init__(self, app: Callable[..., Awaitable[None]]) -> None:
        self._app = app

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Pass the request on, or answer 421."""
        header = next((value for name, value in scope.get("headers", ()) if name == b"host"), b"")
        if scope["type"] != "http" or is_this_host(host_of(header.decode("latin-1"))):
            await self._app(scope, receive, send)
            return
        await send({"type": "http.response.start", "status": 421, "headers": [(b"content-type", b"text/plain")]})
        await send({"type": "http.response.body", "body": self._WORDS})


def listen(host: str, port: int, option: str) -> socket.socket:
    """Return a socket that listens at an address; `option` is the setting to change it.

    Its connections send at once: of two writes in a row the second would wait 40 ms for the first to be acknowledged
    (Nagle's algorithm). asyncio sees to that only where a socket names its protocol.

    Raises BusError if the address is unavailable.
    """
    made = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    try:
        made.bind((host, port))
        made.listen(64)
    except OSError as error:
        made.close()
        why = (error.strerror or str(error)).lower()
        raise BusError(f"cannot listen on {host}:{port}: {why}; choose another port with {option}") from None
    return made
