"""The browser that the pages' tests drive: what it says of a page that is not whole yet."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine")

_BEGINNING = b"<!doctype html><html lang='de'><head><title>slow</title>"
_END = b"</head><body><p id='last'>all of it</p></body></html>"


class _SlowPage(BaseHTTPRequestHandler):
    """A page whose body comes half a second after its head."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(_BEGINNING)
        self.wfile.flush()
        time.sleep(0.5)
        self.wfile.write(_END)

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture
def slow_page() -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), _SlowPage)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    server.server_close()


def test_an_expression_waits_until_its_page_has_been_read(slow_page: str, tmp_path: Path) -> None:
    with Chromium(tmp_path / "profile") as browser:
        browser.open(slow_page)
        browser.until(lambda: browser.evaluate("location.href") == slow_page, PATIENCE_S, "the page was opened")
        for _ in range(3):
            browser.evaluate("location.reload()")
            browser.until(lambda: browser.evaluate("document.title") == "slow", PATIENCE_S, "the page came again")
            assert browser.evaluate("document.body.querySelector('#last').textContent") == "all of it"
