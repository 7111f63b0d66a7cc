"""An address pasted into a tab that has the page open: only what follows the # differs, and nothing is loaded anew."""

from __future__ import annotations

import functools
import http.server
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import chromium
from tests.chromium import Chromium
from tests.patience import PATIENCE_S
from trocar.services.supervisor.page.page_place import DIST

pytestmark = [
    pytest.mark.timeout(600),
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium on this machine"),
    pytest.mark.skipif(not (DIST / "index.html").is_file(), reason="the page is not built"),
]

#: What the page would send to a rig, kept; and an instrument that follows a page's hands.
_RIG = """
globalThis.sent = [];
globalThis.fetch = (path, options) => {
  if (options?.headers) sent.push([path, options.headers["X-Trocar-Token"]]);
  return Promise.resolve({ ok: true });
};
trocar.view.last = {inserted_mm: 0, tick: 0, poses: [], forces: new Float32Array(0)};
trocar.hands.offer("ws://127.0.0.1:9/ws", ["left"]);
"""


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture
def page(tmp_path: Path) -> Iterator[tuple[Chromium, str]]:
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=DIST)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}/"
        with Chromium(tmp_path / "profile") as browser:
            browser.open(address)
            browser.until(lambda: browser.evaluate("Boolean(globalThis.trocar?.hands)"), PATIENCE_S, "the page loaded")
            browser.evaluate(_RIG)
            yield browser, address
        server.shutdown()


def _may_command(browser: Chromium) -> list[bool]:
    buttons = "['arm', 'safe-stop', 'take-hands'].map((id) => !document.getElementById(id).disabled)"
    allowed: list[bool] = browser.evaluate(buttons)
    return allowed


def test_an_open_tab_takes_a_token_that_is_pasted_and_gives_it_up(page: tuple[Chromium, str], tmp_path: Path) -> None:
    browser, address = page
    assert _may_command(browser) == [False, False, False]
    assert "open the address" in browser.text("#hand-hint")
    for token in ("first", "of-the-next-start"):
        browser.open(f"{address}#token={token}")
        browser.until(lambda: all(_may_command(browser)), PATIENCE_S, "the page took the token")
        browser.evaluate("document.getElementById('arm').click()")
        assert browser.evaluate("sent.at(-1)") == ["api/arm", token]
    assert browser.text("#hand-hint").startswith("Move the forceps yourself")
    assert browser.evaluate("trocar.hands.token") == "of-the-next-start"
    browser.screenshot(tmp_path / "page.png")
    browser.open(f"{address}#")
    browser.until(lambda: not any(_may_command(browser)), PATIENCE_S, "the page gave the token up")
