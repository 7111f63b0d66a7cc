"""The rig's web servers: one configuration for all, and serving until something ends."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from typing import Any

import uvicorn

from trocar.services.runtime.web.web_certificate import Certificate

#: How often `serve_until` asks: somebody who ends something waits no longer than is noticed.
LOOK_S = 0.2


def make_server(app: Any, certificate: Certificate | None = None, **options: Any) -> uvicorn.Server:
    """Return a server of an application, encrypted with a certificate; it tells warnings only.

    Args:
        app: An ASGI application without a lifespan.
        certificate: None for plain HTTP.
        options: Others of `uvicorn.Config`; WebSockets are off without them.
    """
    usual = {"log_level": "warning", "access_log": False, "lifespan": "off", "ws": "none"}
    secure = {} if certificate is None else certificate.server_options()
    # At its end connections get a second, as a page holds its stream of events open for good.
    return uvicorn.Server(uvicorn.Config(app, **{**usual, "timeout_graceful_shutdown": 1, **secure, **options}))


async def serve_until(
    server: uvicorn.Server, sock: socket.socket, is_over: Callable[[], bool], look_s: float = LOOK_S
) -> None:
    """Serve until `is_over`, which is asked every `look_s`, or a signal ends the server."""
    serving = asyncio.create_task(server.serve(sockets=[sock]))
    try:
        while not serving.done() and not is_over():
            await asyncio.wait((serving,), timeout=look_s)
    finally:
        server.should_exit = True
        await serving
