"""The school's process beside the rig, and the way to it: requests under ``/school/`` go to its socket.

It judges attempts, keeps them, and knows courses. It belongs to an upper layer, so it is started by its name, and a rig
without it runs as well.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import quote

from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from trocar.services.runtime.bus.endpoints import run_directory
from trocar.services.runtime.config.rig import Transport
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew.processes import ProcessSpec
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page.linked_process import LinkedProcess
from trocar.services.supervisor.page.page_link import PageSetup

_MODULE = "trocar.review.school"
_SCHOOL = ProcessSpec("school", _MODULE)
#: Bytes that are passed on at once, and of the longest head of an answer, which is asyncio's default.
_PART_BYTES = _HEAD_BYTES = 1 << 16
_PATIENCE_S = 30.0  # the longest that a page waits for an answer, as of reports that read whole recordings


def socket_path(transport: Transport) -> Path:
    """Return the path of the school's socket."""
    return run_directory(transport) / "school.sock"


class School:
    """Starts the school's process once the rig has started, and again if it ends."""

    def __init__(self, supervisor: Supervisor, setup: PageSetup, log_directory: Path) -> None:
        self._supervisor = supervisor
        self._process = LinkedProcess(_SCHOOL, log_directory / "school.log", setup, supervisor.say)
        self._is_there = supervisor.rig.replay is None and _is_installed()

    def end(self) -> None:
        """Let the process end, without waiting for it."""
        self._process.end()

    def close(self) -> None:
        """End the process."""
        self._process.close()

    def run_turn(self, now_s: float) -> None:
        """Keep the process running."""
        if self._is_there and self._supervisor.state is not RigState.STARTING:  # what starts with the rig delays it
            self._process.run_turn(now_s)


def _is_installed() -> bool:
    try:
        return find_spec(_MODULE) is not None
    except ModuleNotFoundError:
        return False


async def pass_on(request: Request, path: Path, role: str) -> Response:
    """Return the school's answer to a request of a trainee or an instructor.

    The role is a header that only this process writes. So the path, which the server has decoded, is encoded again, and
    the length of a body must be told: the end of a line in the one, or the other, could else be taken for a request of
    its own, with any role.
    """
    if "transfer-encoding" in request.headers:
        return JSONResponse({"error": "the length of the request must be told"}, 411)
    try:
        reader, writer = await asyncio.open_unix_connection(str(path), limit=_HEAD_BYTES)
    except OSError:
        return JSONResponse({"error": "the school does not answer: it starts, or is not installed"}, 503)
    try:
        target = "/" + quote(request.path_params["path"]) + (f"?{request.url.query}" if request.url.query else "")
        length = int(request.headers.get("content-length") or 0)
        head = f"{request.method} {target} HTTP/1.1\r\nhost: school\r\nconnection: close\r\n"
        writer.write(f"{head}x-trocar-role: {role}\r\ncontent-length: {length}\r\n\r\n".encode("latin-1"))
        async for part in request.stream():
            writer.write(part)
            await writer.drain()
        status, kind = await asyncio.wait_for(_head(reader), _PATIENCE_S)
    except (OSError, ValueError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, TimeoutError):
        writer.close()
        return JSONResponse({"error": "the school has not answered"}, 504)
    except BaseException:  # the request is cancelled, or whoever asked has gone
        writer.close()
        raise
    return _PassedOn(reader, writer, status, kind)


class _PassedOn(StreamingResponse):
    """The school's answer, part by part.

    The connection to the school is closed however the request ends: whoever asked may go before the first part, and
    then the parts' iterator never begins.
    """

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, status: int, kind: str) -> None:
        super().__init__(_parts(reader), status, media_type=kind, headers={"Cache-Control": "no-store"})
        self._writer = writer

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._writer.close()


async def _head(reader: asyncio.StreamReader) -> tuple[int, str]:
    """Return status and media type of an answer."""
    lines = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1").split("\r\n")
    headers = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines[1:])}
    return int(lines[0].split(" ")[1]), headers.get("content-type", "application/octet-stream")


async def _parts(reader: asyncio.StreamReader) -> AsyncIterator[bytes]:
    while part := await reader.read(_PART_BYTES):
        yield part
