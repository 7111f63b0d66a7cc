"""The picture in a window of this host, drawn by a process of its own so that no loop or heartbeat waits for it."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.util
import logging
import os
import signal
import sys
import time

from trocar.services.runtime.errors import DeviceError, MissingPackageError, UserError
from trocar.services.runtime.loop.loop import sleep_until
from trocar.services.runtime.process.health import LatencyPath
from trocar.services.start.off_screen import on_screen
from trocar.services.visualization.display import display_name
from trocar.services.visualization.feed import MARGIN_NS, Feed
from trocar.services.visualization.outputs import Output
from trocar.services.visualization.picture import Picture, PictureLayout
from trocar.services.visualization.render_governor import Demand
from trocar.services.visualization.render_pipe import CLOSED, FRAME, HELLO, NOTICE, OPEN, PAINTED, pack, read_message

#: Most pictures sent to the window and not drawn: another would be older by a picture when it is drawn.
_IN_FLIGHT = 1
#: How long a window may take to open, as for a renderer without one; until it is opened again, as a person who has
#: closed it is not to be pestered; and to close.
_OPEN_S, _RETRY_S, _END_S = 30.0, 5.0, 2.0
#: Attempts at the first window and their spacing, as a virtual display was seen to refuse one and accept the next.
_TRIES, _SOON_S = 3, 0.5


class WindowOutput(Output):
    """A pyvista window for the trainee's monitor.

    Raises UserError if there is no display, pyvista is not installed, or no window opens.
    """

    def __init__(self, painted: LatencyPath, log: logging.Logger) -> None:
        if not display_name():
            raise DeviceError(
                "visualization.viewer: native needs a display, and neither DISPLAY nor WAYLAND_DISPLAY is set"
            )
        if importlib.util.find_spec("pyvista") is None:
            raise MissingPackageError("visualization.viewer: native", "pyvista")
        super().__init__(painted)
        self._log = log
        self._loop = asyncio.new_event_loop()
        self._feed = Feed(painted, in_flight=_IN_FLIGHT)
        self._notice = ""
        self._open = False
        self._pictures = 0
        self._demand = Demand()
        self._showing = self._loop.create_task(self._show_until_closed())
        try:
            self._loop.run_until_complete(self._await_first())
        except UserError:
            self.close()
            raise

    def show(self, layout: PictureLayout, picture: Picture, notice: str) -> None:
        """Pass the picture to the window, which takes the newest when it has drawn the last."""
        if notice != self._notice:
            self._notice = notice
            self._feed.tell(notice)
        self._feed.offer(self._message(layout, picture))

    def wait_until(self, deadline_ns: int) -> None:
        """Exchange messages with the window."""
        spare_ns = deadline_ns - time.monotonic_ns() - MARGIN_NS
        self._loop.run_until_complete(asyncio.sleep(max(0.0, spare_ns * 1e-9)))
        sleep_until(deadline_ns)

    def wanted_hz(self) -> float | None:
        """Return somewhat more than the recently painted rate; None, for all, before the first."""
        return self._demand.count(time.monotonic(), self._pictures)

    def gauges(self) -> dict[str, float]:
        """Return whether the window is open, and its number of drawn pictures."""
        return {"window_open": float(self._open), "window_pictures": float(self._pictures)}

    def close(self) -> None:
        """Close the window."""
        self._showing.cancel()
        self._loop.run_until_complete(asyncio.wait([self._showing]))
        self._loop.close()

    async def _await_first(self) -> None:
        """Wait for the window, or raise the reason why it did not open."""
        until_s = time.monotonic() + _OPEN_S
        while not self._open and not self._showing.done() and time.monotonic() < until_s:
            await asyncio.sleep(0.02)
        if self._showing.done():
            self._showing.result()
        elif not self._open:
            self._showing.cancel()
            raise DeviceError(f"visualization.viewer: no window on display {display_name()} within {_OPEN_S:.0f} s")

    async def _show_until_closed(self) -> None:
        """Keep a window open until a person closes it, reopening it after failures."""
        opened_once = told = False
        refused = 0
        while True:
            status = await self._show_once()
            if self.closed:
                return
            opened_once, told = opened_once or self._open, told and not self._open
            self._open = False
            why = f"the window on display {display_name()} {_how(status)}: the display went away, or its driver failed"
            refused += not opened_once
            if refused == _TRIES:
                raise DeviceError(f"visualization.viewer: {why.replace('went away', 'is not there')}")
            if opened_once and not told:
                self._log.warning("%s; the rig goes on without a picture until it opens again", why)
                told = True
            await asyncio.sleep(_RETRY_S if opened_once else _SOON_S)

    async def _show_once(self) -> int:
        worker = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "trocar.services.visualization.window_worker",
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
            # Threads of the software renderer would delay the loops: lateness was 4 instead of 1 ms.
            env={**on_screen(os.environ), "LP_NUM_THREADS": "1"},
            start_new_session=True,  # `trocar.services.runtime.realtime.autogroup`
        )  # fmt: skip
        sending = asyncio.ensure_future(self._send(worker))
        try:
            await self._listen(worker)
            return await worker.wait()
        finally:
            sending.cancel()
            await _end(worker, 0.0 if self.closed else _END_S)

    async def _send(self, worker: asyncio.subprocess.Process) -> None:
        assert worker.stdin is not None
        self._feed.reset()
        if self._notice:
            self._feed.tell(self._notice)
        while True:
            for part in await self._feed.next():
                if isinstance(part, bytes):
                    worker.stdin.write(pack(FRAME, part))
                else:
                    worker.stdin.write(pack(HELLO if part is self._hello else NOTICE, part.encode()))
            with contextlib.suppress(ConnectionError):  # its end is detected by `_listen`
                await worker.stdin.drain()

    async def _listen(self, worker: asyncio.subprocess.Process) -> None:
        assert worker.stdout is not None
        with contextlib.suppress(asyncio.IncompleteReadError):
            while True:
                kind, data = await read_message(worker.stdout)
                if kind == PAINTED:
                    self._pictures += 1
                    self._feed.acknowledge(int.from_bytes(data, "little"))
                self._open = self._open or kind == OPEN
                self.closed = self.closed or kind == CLOSED


async def _end(worker: asyncio.subprocess.Process, patience_s: float) -> None:
    """End the drawing process; after `patience_s` it is killed, as the view is silent meanwhile."""
    assert worker.stdin is not None
    worker.stdin.close()  # makes it end
    try:
        await asyncio.wait_for(worker.wait(), patience_s)
    except TimeoutError:
        with contextlib.suppress(ProcessLookupError):  # it has ended meanwhile
            worker.kill()
        await worker.wait()


def _how(status: int) -> str:
    return f"ended by {signal.Signals(-status).name}" if status < 0 else f"ended with exit code {status}"
