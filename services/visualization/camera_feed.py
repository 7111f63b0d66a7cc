"""Pictures rendered on this host for clients that cannot draw: snapshots and MJPEG, made by a process of their own.

Software rendering costs 12 ms of processor time a picture, and a faulty graphics driver ends in a segmentation fault.
Neither may affect the loop, so a worker renders; the death of a worker is an error message to the client.
"""

from __future__ import annotations

import asyncio
import os
import sys
import time

from trocar.services.visualization.feed import FeedMessage
from trocar.services.visualization.render_pipe import FRAME, HELLO, RENDER, pack, read_message

_IDLE_S = 20.0
_START_TIMEOUT_S = 30.0
_RATE_HZ = 30.0


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
        self._lock = asyncio.Lock()
        self._asked_s = 0.0
        self._rendered_s = 0.0

    def offer(self, message: FeedMessage) -> None:
        """Store the newest message; end an idle worker."""
        self._newest = message
        worker = self._worker
        if worker is not None and not self._lock.locked() and time.monotonic() - self._asked_s > _IDLE_S:
            self._worker = None
            worker.stdin.close()  # type: ignore[union-attr]  # the worker ends with its input

    async def image(self, kind: str) -> bytes | None:
        """Return the newest picture as "png" or "jpeg", at most 30 a second; None, with `fault` set, on failure."""
        async with self._lock:
            await asyncio.sleep(self._rendered_s + 1.0 / _RATE_HZ - time.monotonic())
            self._asked_s = self._rendered_s = time.monotonic()
            message = self._newest
            if message is None:
                self.fault = "nothing has been composed yet"
                return None
            try:
                return await asyncio.wait_for(self._render(message, kind), _START_TIMEOUT_S)
            except (OSError, EOFError, TimeoutError, asyncio.IncompleteReadError) as error:
                self.fault = await self._bury(error)
                return None

    async def close(self) -> None:
        """End the worker."""
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
        environment.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
        self._epoch = -1
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
