"""Debian's Chromium without a screen, driven over its DevTools protocol: it draws in software, as many hosts do."""

from __future__ import annotations

import base64
import ctypes
import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

from websockets.sync.client import ClientConnection, connect

from tests.patience import PATIENCE_S

_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)
#: What the protocol says of a page that is left while it is asked, for another one or for itself anew.
_LEFT = ("context", "navigated")

#: What a page that is still being read answers: it has no root, no body, or only some of its elements.
_BEING_READ = "the page is still being read"

#: What a browser of a container needs, and what keeps it from doing anything but the page.
_OPTIONS = (
    "--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0", "--remote-allow-origins=*", "--no-first-run", "--disable-extensions",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--mute-audio",
    "--disable-dev-shm-usage", "--hide-scrollbars",
)  # fmt: skip


class PageLeftError(Exception):
    """The page was left before it answered: what it would have said, the next one may be asked."""


def find() -> str | None:
    """Return the browser, None where there is none."""
    return shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


class Chromium:
    """A browser with one page while a ``with`` block lasts; it has `profile` to itself."""

    def __init__(self, profile: Path, size: tuple[int, int] = (1280, 800), nice: int = 0) -> None:
        self._profile = profile
        self._size = size
        self._nice = nice
        self._last = 0
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        program = find()
        assert program is not None
        width, height = self._size
        self._log = (self._profile.parent / f"{self._profile.name}.log").open("wb")
        self._process = subprocess.Popen(
            [program, *_OPTIONS, f"--user-data-dir={self._profile}", f"--window-size={width},{height}", "about:blank"],
            stdout=self._log, stderr=self._log, start_new_session=True, preexec_fn=self._prepare,
        )  # fmt: skip
        try:
            self._socket = self._attach()
            self.command("Page.enable")
            self.command("Runtime.enable")
            self.set_size(width, height)
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def _prepare(self) -> None:
        """End with whoever started it, however that ends: a browser that is left over takes a core from all later."""
        os.nice(self._nice)
        _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)

    def _end(self) -> None:
        self._stack.close()
        os.killpg(self._process.pid, 9)
        self._process.wait()
        self._log.close()

    def _attach(self) -> ClientConnection:
        """Return the connection to the page that the browser opened."""
        import httpx

        port_file = self._profile / "DevToolsActivePort"
        self.until(lambda: port_file.is_file() and "\n" in port_file.read_text(), PATIENCE_S, "the browser started")
        port = int(port_file.read_text().splitlines()[0])
        pages: list[dict[str, str]] = []

        def opened() -> bool:
            targets = httpx.get(f"http://127.0.0.1:{port}/json", timeout=PATIENCE_S).json()
            pages[:] = [target for target in targets if target["type"] == "page"]
            return bool(pages)

        self.until(opened, PATIENCE_S, "the browser opened a page")
        return self._stack.enter_context(
            connect(pages[0]["webSocketDebuggerUrl"], max_size=None, compression=None, open_timeout=PATIENCE_S)
        )

    @staticmethod
    def until(condition: Callable[[], object], seconds: float, what: str) -> None:
        """Wait until `condition` holds; of a page that is just being left nothing does."""
        end = time.monotonic() + seconds
        while not _holds(condition):
            assert time.monotonic() < end, f"not within {seconds} s: {what}"
            time.sleep(0.05)

    def command(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command of the protocol; return its result. Raises PageLeftError."""
        self._last += 1
        self._socket.send(json.dumps({"id": self._last, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv(timeout=PATIENCE_S))
            if answer.get("id") == self._last:
                if any(word in answer.get("error", {}).get("message", "") for word in _LEFT):
                    raise PageLeftError(answer)
                assert "error" not in answer, answer
                result: dict[str, Any] = answer["result"]
                return result

    def set_size(self, width: int, height: int, scale: float = 1.0, *, phone: bool = False) -> None:
        """Make the page so large."""
        self.command(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=phone
        )

    def open(self, address: str) -> None:
        """Go to an address, without waiting for what is there."""
        self.command("Page.navigate", url=address)

    def evaluate(self, expression: str) -> Any:
        """Return what JavaScript statements, or the promise that the last one is, come to. Raises PageLeftError.

        They wait until their page has been read: a page that reloads itself has no root for a moment.
        """
        in_a_whole_page = f"if (document.readyState === 'loading') {json.dumps(_BEING_READ)}; else {{\n{expression}\n}}"
        value = _BEING_READ
        end = time.monotonic() + PATIENCE_S
        while value == _BEING_READ:
            assert time.monotonic() < end, f"not within {PATIENCE_S} s: the page was read"
            done = self.command("Runtime.evaluate", expression=in_a_whole_page, returnByValue=True, awaitPromise=True)
            assert "exceptionDetails" not in done, done
            value = done["result"].get("value")
        return value

    def text(self, selector: str) -> str:
        """Return the text of an element."""
        return str(self.evaluate(f"document.querySelector({selector!r})?.textContent ?? ''"))

    def screenshot(self, path: Path, *, whole: bool = False) -> None:
        """Write what is to be seen as a PNG; with `whole`, the page as long as it is."""
        image = self.command("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(image["data"]))


def _holds(condition: Callable[[], object]) -> bool:
    try:
        return bool(condition())
    except PageLeftError:
        return False
