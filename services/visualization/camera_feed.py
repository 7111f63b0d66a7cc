"""Pictures rendered on this host for clients that cannot draw: snapshots and MJPEG, made by a process of their own.

Software rendering costs 12 ms of processor time a picture, and a faulty graphics driver ends in a segmentation fault.
Neither may affect the loop, so a worker renders; the death of a worker is an error message to the client.
"""

from __future__ import annotations

import asyncio
import os
import sys
import time

from trocar.services.start.off_screen import draw_off_screen
from trocar.services.visualization.feed import FeedMessage
from trocar.services.visualization.render_pipe import FRAME, HELLO, RENDER, pack, read_message

_IDLE_S = 20.0  # a renderer takes seconds to start, so one waits for the next snapshot of a person who takes some
#: Patience of a request; of a renderer that starts, which on a slow machine takes longer; and of one that has started.
_ANSWER_S, _START_S, _RENDER_S = 5.0, 120.0, 30.0
_RATE_HZ = 30.0  # as that of the page's picture is promised


class CameraFeed:
    """Starts the worker at the first request and ends it after a while without requests.

    Attributes:
        fault: str. Reason of a failure of the last request.
    """

    def __init__(self) -> None:
        self.fault = ""
        self._newest: FeedMessage | None = None
        self._worker: asyncio.subprocess.Process | None = None
        self._epoch = -1
        self._rendering: asyncio.Task[bytes | None] | None = None
        self._kind = ""
        self._has_started = False
        self._asked_s = 0.0
        self._rendered_s = 0.0

    def offer(self, message: FeedMessage) -> None:
        """Store the newest message; end an idle worker."""
        self._newest = message
        worker = self._worker
        if worker is not None and not self._is_rendering and time.monotonic() - self._asked_s > _IDLE_S:
            self._worker = None
            worker.stdin.close()  # type: ignore[union-attr]  # the worker ends with its input

    async def image(self, kind: str) -> bytes | None:
        """Return the newest picture as "png" or "jpeg", at most 30 a second; None, with `fault` set, on failure.

        A request waits a few seconds at most. Its renderer goes on starting without it, for the next one.
        """
        until_s = time.monotonic() + _ANSWER_S
        while True:
            if self._rendering is None or self._rendering.done():  # what a request did not wait for is old by now
                self._kind, self._rendering = kind, asyncio.create_task(self._draw(kind))
            rendering, kind_of_it = self._rendering, self._kind
            await asyncio.wait((rendering,), timeout=max(0.0, until_s - time.monotonic()))
            if not rendering.done():
                what = "is busy" if self._has_started else "is still starting"
                self.fault = f"the renderer {what}; ask again in a few seconds"
                return None
            if kind_of_it == kind:
                return rendering.result()

    @property
    def _is_rendering(self) -> bool:
        return self._rendering is not None and not self._rendering.done()

    async def _draw(self, kind: str) -> bytes | None:
        """Return the newest picture from the worker, None, with `fault` set, on failure."""
        await asyncio.sleep(self._rendered_s + 1.0 / _RATE_HZ - time.monotonic())
        self._asked_s = self._rendered_s = time.monotonic()
        message = self._newest
        if message is None:
            self.fault = "nothing has been composed yet"
            return None
        try:
            patience_s = _RENDER_S if self._has_started else _START_S
            image = await asyncio.wait_for(self._render(message, kind), patience_s)
        except (OSError, EOFError, TimeoutError, asyncio.IncompleteReadError) as error:
            self.fault = await self._bury(error)
            return None
        self._has_started = True
        self._asked_s = time.monotonic()
        return image

    async def close(self) -> None:
        """End the worker."""
        rendering, self._rendering = self._rendering, None
        if rendering is not None:
            rendering.cancel()
            await asyncio.wait((rendering,))
        if self._worker is not None:
            self.fault = await self._bury(None)

    async def _render(self, message: FeedMessage, kind: str) -> bytes:
        worker = self._worker or await self._start()
        assert worker.stdin is not None
        assert worker.stdout is not None
        if message.epoch != self._epoch:
            worker.stdin.write(pack(HELLO, message.hello.encode()))
            self._epoch = message.epoch
        worker.stdin.write(pack(FRAME, message.data) + pack(RENDER, kind.encode()))
        await worker.stdin.drain()
        return (await read_message(worker.stdout))[1]

    async def _start(self) -> asyncio.subprocess.Process:
        # One thread of the software renderer, and the lowest priority, as the loops come first.
        environment = {**os.environ, "LP_NUM_THREADS": "1"}
        draw_off_screen(environment)
        self._epoch = -1
        self._has_started = False
        self._worker = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "trocar.services.visualization.render_worker",
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, env=environment,
        )  # fmt: skip
        return self._worker

    async def _bury(self, error: BaseException | None) -> str:
        worker, self._worker = self._worker, None
        if worker is None:
            return str(error)
        if worker.returncode is None:
            worker.kill()
        code = await worker.wait()
        return f"the renderer ended with code {code} ({type(error).__name__})"
