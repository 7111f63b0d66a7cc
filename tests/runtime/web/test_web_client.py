"""Programs know a rig's server by its certificate, and tell nobody else anything."""

from __future__ import annotations

import http.server
import ssl
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from trocar.services.cli.arm import RigPage, state_at
from trocar.services.runtime.errors import BusError
from trocar.services.runtime.web.web_certificate import Certificate, make
from trocar.services.runtime.web.web_client import WrongCertificateError, open_connection, open_url


class _Answer(http.server.BaseHTTPRequestHandler):
    heard: list[str]

    def do_GET(self) -> None:
        self.heard.append(self.path)
        self.send_response(200)
        self.end_headers()
        self.wfile.write(b'{"t": 1.5}')

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@contextmanager
def _serving(certificate: Certificate) -> Iterator[tuple[str, list[str]]]:
    heard: list[str] = []
    handler = type("Handler", (_Answer,), {"heard": heard})
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate.file, certificate.key_file)
        server.socket = context.wrap_socket(server.socket, server_side=True)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"https://127.0.0.1:{server.server_port}", heard
        finally:
            server.shutdown()


@pytest.fixture
def certificate(tmp_path: Path) -> Certificate:
    return make(tmp_path / "keys", ["bench-1.lab"])


@pytest.mark.parametrize("written", ["as printed", "plain"])
def test_whoever_has_the_fingerprint_is_spoken_to_at_any_address(certificate: Certificate, written: str) -> None:
    given = certificate.fingerprint if written == "as printed" else certificate.fingerprint.replace(":", "").lower()
    with _serving(certificate) as (address, heard):
        assert state_at(RigPage(address, given)) == {"t": 1.5}
        with closing(open_connection(address, PATIENCE_S, given)) as link:
            link.request("GET", "/snapshot.png")
            assert link.getresponse().status == 200
    assert heard == ["/api/state", "/snapshot.png"]


def test_whoever_has_another_certificate_hears_nothing(certificate: Certificate, tmp_path: Path) -> None:
    other = make(tmp_path / "other", ["bench-1.lab"])
    with _serving(other) as (address, heard):
        with pytest.raises(BusError, match=r"has the fingerprint .* which is not the one named"):
            state_at(RigPage(address, certificate.fingerprint))
        with pytest.raises(WrongCertificateError), closing(open_connection(address, 9.0, "AB:CD")) as link:
            link.request("GET", "/api/state")
        with pytest.raises(BusError, match="name with --fingerprint the one that the rig printed"):
            state_at(RigPage(address))
    assert heard == []


def test_an_open_server_is_asked_as_before() -> None:
    handler = type("Handler", (_Answer,), {"heard": []})
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        request = urllib.request.Request(f"http://127.0.0.1:{server.server_port}/")
        assert open_url(request, PATIENCE_S).status == 200
        server.shutdown()
