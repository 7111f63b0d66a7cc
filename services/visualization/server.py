"""The view's web server, without a thread: it runs while the loop waits for its next deadline."""

from __future__ import annotations

import asyncio
import contextlib
import struct
import time
from collections.abc import AsyncIterator
from typing import Annotated
from urllib.parse import urlsplit

import msgspec
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route, WebSocketRoute
from starlette.status import WS_1008_POLICY_VIOLATION, WS_1013_TRY_AGAIN_LATER
from starlette.websockets import WebSocket, WebSocketDisconnect

from trocar.services.runtime.config.rig import ViewSettings
from trocar.services.runtime.loop.loop import sleep_until
from trocar.services.runtime.web.web_certificate import Certificate
from trocar.services.runtime.web.web_headers import SafeHeaders
from trocar.services.runtime.web.web_host import KnownHost, host_of, is_this_host, listen
from trocar.services.runtime.web.web_server import make_server
from trocar.services.visualization.camera_feed import CameraFeed
from trocar.services.visualization.feed import MARGIN_NS, Feed, Feeds
from trocar.services.visualization.page_hands import PageHands

MAX_CLIENTS = 16  # a class and its teachers, as more would take the processor from the loops
#: Least rate of a client, as a slow picture is to be told from a frozen one.
MIN_HZ = 1.0
_ECHO = struct.Struct("<Q")
_BOUNDARY = "frame"


class PictureRate(msgspec.Struct, tag="want", tag_field="type", frozen=True):
    """Rate that a client accepts: ``{"type": "want", "pictures_hz": 15}``; null for every picture."""

    pictures_hz: Annotated[float, msgspec.Meta(ge=MIN_HZ, le=1000)] | None


class ViewServer:
    """WebSockets ``/ws`` and ``/hands``, ``/snapshot.png`` and ``/camera.mjpeg`` on the view's port.

    With a `certificate` they are encrypted. Raises UserError if the port is in use.
    """

    def __init__(
        self,
        settings: ViewSettings,
        feeds: Feeds,
        camera: CameraFeed,
        hands: PageHands,
        certificate: Certificate | None = None,
    ) -> None:
        self._feeds = feeds
        self._hands = hands
        self._camera = camera
        self._socket = listen(settings.host, settings.port, "--set visualization.port=N")
        self.port: int = self._socket.getsockname()[1]
        app = Starlette(
            routes=[
                WebSocketRoute("/ws", self._view),
                WebSocketRoute("/hands", self._serve_hands),
                Route("/snapshot.png", self._snapshot),
                Route("/camera.mjpeg", self._mjpeg),
                Route("/healthz", _alive),
            ],
            middleware=[Middleware(SafeHeaders), Middleware(KnownHost)],
        )
        sockets = {"ws": "websockets-sansio", "ws_per_message_deflate": False, "ws_max_size": 1024}
        self._loop = asyncio.new_event_loop()
        self._server = make_server(app, certificate, **sockets)
        self._server.capture_signals = contextlib.nullcontext  # the process handles signals, by ending its loop
        self._serving = self._loop.create_task(self._server.serve(sockets=[self._socket]))

    def run_until(self, deadline_ns: int) -> None:
        """Serve until `deadline_ns` of the monotonic clock."""
        spare_ns = deadline_ns - time.monotonic_ns() - MARGIN_NS
        self._loop.run_until_complete(asyncio.sleep(max(0.0, spare_ns * 1e-9)))
        sleep_until(deadline_ns)

    def close(self) -> None:
        """Disconnect every client and release the port."""
        self._server.should_exit = True
        self._loop.run_until_complete(self._shut())
        self._loop.close()
        self._socket.close()

    async def _shut(self) -> None:
        await self._camera.close()
        await self._serving

    async def _view(self, socket_: WebSocket) -> None:
        if not may_look(socket_.headers.get("origin"), socket_.headers.get("host")):
            await socket_.close(code=WS_1008_POLICY_VIOLATION)
            return
        await socket_.accept()
        if len(self._feeds) >= MAX_CLIENTS:
            await socket_.close(code=WS_1013_TRY_AGAIN_LATER)
            return
        feed = self._feeds.add()
        sending = asyncio.ensure_future(_send(socket_, feed))
        try:
            await _listen(socket_, feed)
        finally:
            self._feeds.remove(feed)
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await sending

    async def _serve_hands(self, socket_: WebSocket) -> None:
        if not may_look(socket_.headers.get("origin"), socket_.headers.get("host")):
            await socket_.close(code=WS_1008_POLICY_VIOLATION)
            return
        await socket_.accept()
        with contextlib.suppress(WebSocketDisconnect, KeyError):  # it is gone, or sends bytes
            await self._hands.serve(_Page(socket_))

    async def _snapshot(self, request: Request) -> Response:
        image = await self._camera.image("png")
        if image is None:
            return self._no_picture()
        return Response(image, media_type="image/png", headers={"Cache-Control": "no-store"})

    def _no_picture(self) -> Response:
        headers = {"Retry-After": "3", "Cache-Control": "no-store"}
        return PlainTextResponse(f"no picture: {self._camera.fault}\n", status_code=503, headers=headers)

    async def _mjpeg(self, request: Request) -> Response:
        if await self._camera.image("jpeg") is None:
            return self._no_picture()
        return StreamingResponse(
            _multipart(self._camera), media_type=f"multipart/x-mixed-replace; boundary={_BOUNDARY}"
        )


class _Page:
    """A page with hands."""

    def __init__(self, socket_: WebSocket) -> None:
        self._socket = socket_
        self.receive_text = socket_.receive_text
        self.send_text = socket_.send_text

    async def close(self, code: int, reason: str) -> None:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            await self._socket.close(code, reason)


async def _send(socket_: WebSocket, feed: Feed) -> None:
    while True:
        for part in await feed.next():
            if isinstance(part, str):
                await socket_.send_text(part)
            else:
                await socket_.send_bytes(part)


async def _listen(socket_: WebSocket, feed: Feed) -> None:
    """Process acknowledgements and rates until the client disconnects; other messages are ignored."""
    while True:
        message = await socket_.receive()
        if message["type"] == "websocket.disconnect":
            return
        data = message.get("bytes")
        if data is not None and len(data) == _ECHO.size:
            feed.acknowledge(_ECHO.unpack(data)[0])
        text = message.get("text")
        if text is not None:
            with contextlib.suppress(msgspec.DecodeError):
                feed.want(msgspec.json.decode(text, type=PictureRate).pictures_hz)


async def _multipart(camera: CameraFeed) -> AsyncIterator[bytes]:
    while True:
        image = await camera.image("jpeg")
        if image is None:
            return
        head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(image)}\r\n\r\n"
        yield head.encode() + image + b"\r\n"


async def _alive(request: Request) -> Response:
    return PlainTextResponse("ok\n")


def may_look(origin: str | None, host: str | None) -> bool:
    """Return whether a page from `origin` may read the view that it reached as `host`.

    Pages of this host, at any port, and programs without origin may. Otherwise any web page visited at the rig could
    open the view's socket.
    """
    if origin is None:
        return True
    here = host_of(host)
    return bool(here) and urlsplit(origin).hostname == here and is_this_host(here)
