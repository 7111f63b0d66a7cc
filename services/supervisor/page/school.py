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

import h11
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from trocar.services.runtime.bus.endpoints import run_directory
from trocar.services.runtime.config.rig import Transport
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew.processes import ProcessSpec
from trocar.services.supervisor.judge.state_machine import RigState
from trocar.services.supervisor.page.helper import Helper
from trocar.services.supervisor.page.page_place import page_file

_MODULE = "trocar.review.school"
_SCHOOL = ProcessSpec("school", _MODULE)
#: Bytes that are passed on at once, and of the longest head of an answer: as many as asyncio reads at once.
_PART_BYTES = _HEAD_BYTES = 1 << 16
_PATIENCE_S = 30.0  # the longest that a page waits for an answer, as of reports that read whole recordings


def socket_path(transport: Transport) -> Path:
    """Return the path of the school's socket."""
    return run_directory(transport) / "school.sock"


class School(Helper):
    """Starts the school's process once the rig has started, and again if it ends."""

    def __init__(self, supervisor: Supervisor, log_directory: Path) -> None:
        self._supervisor = supervisor
        place = page_file(supervisor.rig.transport)
        super().__init__(_SCHOOL, log_directory / "school.log", supervisor.say, place)
        self._is_there = supervisor.rig.replay is None and _is_installed()

    def run_turn(self, now_s: float) -> None:
        """Keep the process running."""
        if self._is_there and self._supervisor.state is not RigState.STARTING:  # what starts with the rig delays it
            super().run_turn(now_s)


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
        asked = _Asked(*await asyncio.open_unix_connection(str(path)))
    except OSError:
        return JSONResponse({"error": "the school does not answer: it starts, or is not installed"}, 503)
    try:
        await asked.send(request, role)
        head = await asyncio.wait_for(asked.event(), _PATIENCE_S)
        if not isinstance(head, h11.Response):
            raise h11.RemoteProtocolError("no answer")
    except (OSError, h11.ProtocolError, TimeoutError):
        asked.close()
        return JSONResponse({"error": "the school has not answered"}, 504)
    except BaseException:  # the request is cancelled, or whoever asked has gone
        asked.close()
        raise
    return _PassedOn(asked, head)


class _Asked:
    """A request to the school, and its answer."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer
        self._http = h11.Connection(h11.CLIENT, max_incomplete_event_size=_HEAD_BYTES)

    async def send(self, request: Request, role: str) -> None:
        target = "/" + quote(request.path_params["path"]) + (f"?{request.url.query}" if request.url.query else "")
        length = request.headers.get("content-length") or "0"
        headers = {"host": "school", "connection": "close", "x-trocar-role": role, "content-length": length}
        await self._write(h11.Request(method=request.method, target=target, headers=list(headers.items())))
        async for part in request.stream():
            await self._write(h11.Data(data=part))
        await self._write(h11.EndOfMessage())

    async def _write(self, event: h11.Event) -> None:
        self._writer.write(self._http.send(event) or b"")
        await self._writer.drain()

    async def event(self) -> object:
        """Return what comes next of the answer. Raises h11.RemoteProtocolError if it is none, or has no end."""
        while (event := self._http.next_event()) is h11.NEED_DATA:
            self._http.receive_data(await self._reader.read(_PART_BYTES))
        return event

    async def parts(self) -> AsyncIterator[bytes]:
        while isinstance(event := await self.event(), h11.Data):
            yield bytes(event.data)

    def close(self) -> None:
        self._writer.close()


class _PassedOn(StreamingResponse):
    """The school's answer, part by part.

    The connection to the school is closed however the request ends: whoever asked may go before the first part, and
    then the parts' iterator never begins.
    """

    def __init__(self, asked: _Asked, head: h11.Response) -> None:
        kind = dict(head.headers).get(b"content-type", b"application/octet-stream").decode("latin-1")
        super().__init__(asked.parts(), head.status_code, media_type=kind, headers={"Cache-Control": "no-store"})
        self._asked = asked

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._asked.close()
