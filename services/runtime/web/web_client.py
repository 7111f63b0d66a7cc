"""Connections of programs to the rig's web servers, which are known by the fingerprint of their certificate."""

from __future__ import annotations

import http.client
import ssl
import urllib.request
from typing import Any
from urllib.parse import urlsplit

from trocar.services.runtime.web.web_certificate import fingerprint_of


class WrongCertificateError(OSError):
    """Whoever answers at an address has another certificate than the one that was named."""


class _Pinned(http.client.HTTPSConnection):
    """A connection on which nothing is sent before the server has shown the certificate of a fingerprint."""

    def __init__(self, host: str, *, fingerprint: str, **options: Any) -> None:
        super().__init__(host, context=_unverified(), **options)
        self._fingerprint = _plain(fingerprint)

    def connect(self) -> None:
        """Connect. Raises WrongCertificateError if the server has another certificate."""
        super().connect()
        found = fingerprint_of(self.sock.getpeercert(binary_form=True) or b"")
        if _plain(found) != self._fingerprint:
            self.close()
            raise WrongCertificateError(f"its certificate has the fingerprint {found}, which is not the one named")


def open_connection(address: str, timeout_s: float, fingerprint: str = "") -> http.client.HTTPConnection:
    """Return a connection to the server at an ``http://`` or ``https://`` address, which opens with the first request.

    With a `fingerprint` only the server with that certificate is spoken to; without one, the system's own authorities
    have to vouch for an ``https://`` server.
    """
    parts = urlsplit(address)
    if parts.scheme != "https":
        return http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=timeout_s)
    if fingerprint:
        return _Pinned(parts.hostname or "", port=parts.port, timeout=timeout_s, fingerprint=fingerprint)
    return http.client.HTTPSConnection(parts.hostname or "", parts.port, timeout=timeout_s)


def open_url(request: urllib.request.Request, timeout_s: float, fingerprint: str = "") -> http.client.HTTPResponse:
    """Return the answer to a request; raises as `urllib.request.urlopen` does, and knows the server as above.

    An answer that leads elsewhere raises HTTPError like a refusal: what was sent would not go there, but a token would.
    """
    handlers = [_PinnedHandler(fingerprint)] if fingerprint else []
    opener = urllib.request.build_opener(_NoRedirect, *handlers)
    answer: http.client.HTTPResponse = opener.open(request, timeout=timeout_s)
    return answer


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *_: Any) -> None:
        """Go nowhere."""


class _PinnedHandler(urllib.request.HTTPSHandler):
    def __init__(self, fingerprint: str) -> None:
        super().__init__()
        self._fingerprint = fingerprint

    def https_open(self, req: urllib.request.Request) -> http.client.HTTPResponse:
        """Open a request on a pinned connection."""

        def connection(host: str, **options: Any) -> _Pinned:
            return _Pinned(host, fingerprint=self._fingerprint, timeout=options["timeout"])

        return self.do_open(connection, req)


def _unverified() -> ssl.SSLContext:
    """Return a context that accepts every certificate: what it is, `_Pinned` compares itself."""
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def _plain(fingerprint: str) -> str:
    return "".join(each for each in fingerprint.upper() if each in "0123456789ABCDEF")
