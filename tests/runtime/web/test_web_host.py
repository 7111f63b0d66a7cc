"""The socket of a web server of the rig."""

from __future__ import annotations

import socket

from trocar.services.runtime.web.web_host import listen


def test_a_connection_sends_at_once() -> None:
    """The second of two writes waited 40 ms until the first was acknowledged."""
    with listen("127.0.0.1", 0, "nothing") as listener, socket.create_connection(listener.getsockname()):
        accepted, _ = listener.accept()
        with accepted:
            assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
