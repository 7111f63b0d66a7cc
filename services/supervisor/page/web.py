"""The page's web application: static files, events, commands, metrics, from a `PageContext`; it uses no socket."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import secrets
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec
import prometheus_client
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import Receive, Scope, Send

import trocar.protocol.bodies as bodies
from trocar.protocol.topics import JUDGEMENT_S
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.errors import BusError, ConfigError
from trocar.services.runtime.web.web_headers import SafeHeaders, policy_of_files
from trocar.services.runtime.web.web_host import KnownHost, host_of
from trocar.services.supervisor.control.commands import Command, What
from trocar.services.supervisor.page.page_place import DIST
from trocar.services.supervisor.page.school import pass_on, socket_path
from trocar.services.training.scenario import scenario_names, scenario_of

#: Longest body of a command: a moment (`_MOMENT`) has 206 characters at most; longest line for a shown recording: `+`
#: and a number of seconds.
_ORDER_BYTES, _LINE_BYTES = 1024, 32
_REPLAY_HEADER = "X-Trocar-Replay"
_BEFORE_HEADER, _BEFORE = "X-Trocar-Before", re.compile(r"([0-9]{1,15}) ([0-9]{1,9}(?:\.[0-9]{1,9})?)")
_MOMENT = re.compile(r"([\w-]{1,128}\.mcap) ([0-9]{1,12}) ([\w-]{1,64})", re.ASCII)
#: A host as a Content-Security-Policy can name it, which an IPv6 address is not.
_PLAIN_HOST = re.compile(r"[a-z0-9-]+(\.[a-z0-9-]+)*")
#: Place of the rig's data in the built page, with none in it.
UNTOLD = '<script id="rig" type="application/json">null'
_NOT_KEPT = {"Cache-Control": "no-store"}
_NOT_BUILT = """<!doctype html><title>Trocar</title><h1>The page is not built</h1>
<p>The rig runs, but <code>services/visualization/web/dist</code> is missing. Build it once with
<code>python -m trocar.services.visualization.web.build</code> and load this page again.</p>
<p>Meanwhile: <a href="/events">/events</a>, <a href="/metrics">/metrics</a>, <code>trocar diagnose top</code>.</p>"""


@dataclass(slots=True)
class PageContext:
    """Data and functions for the page.

    `latest` is the rig's state, replaced as a whole five times a second, empty before the supervisor has said anything.

    `registries` are the metrics by level; `healthy` tells whether the rig works, with a description; `view_port` the
    port of the picture; `replays` whether a recording is shown that can be controlled; `switches` whether scenarios can
    be switched; `ask` sends a command and waits for its outcome; `class_token` is that of an instructor, if any.
    """

    rig: Rig
    scene: str
    registries: Mapping[str, prometheus_client.CollectorRegistry]
    ask: Callable[[Command], bodies.Answer]
    healthy: Callable[[], tuple[bool, str]]
    view_port: Callable[[], int]
    replays: Callable[[], bool] = lambda: False
    switches: bool = False
    dist: Path = DIST
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16))
    class_token: str = ""
    latest: bytes = b""
    closing: bool = False


class _BuiltFiles(StaticFiles):
    """Static files of a folder that may be created later."""

    def __init__(self, folder: Path) -> None:
        super().__init__(directory=folder, check_dir=False)
        self._folder = folder

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if self._folder.is_dir():
            await super().__call__(scope, receive, send)
        else:
            await Response(status_code=404)(scope, receive, send)


def build_app(context: PageContext) -> Starlette:
    """Return the web application."""
    page = _Endpoints(context)
    routes: list[BaseRoute] = [
        Route("/events", page.events),
        Route("/api/rig", page.rig),
        Route("/api/state", page.state),
        Route("/api/arm", page.arm, methods=["POST"]),
        Route("/api/safe_stop", page.safe_stop, methods=["POST"]),
        Route("/api/attempt", page.attempt, methods=["POST"]),
        Route("/api/replay", page.replay, methods=["POST"]),
        Route("/api/scenario", page.scenario, methods=["POST"]),
        Route("/api/restart", page.restart, methods=["POST"]),
        Route("/api/take_over", page.take_over, methods=["POST"]),
        Route("/school/{path:path}", page.school, methods=["GET", "POST", "PUT"]),
        Route("/metrics", page.metrics),
        Route("/healthz", page.healthz),
        # The page is looked up at each request, as it may be built while the rig runs.
        Route("/", page.index),
        Route("/index.html", page.index),
        Mount("/", _BuiltFiles(context.dist)),
    ]
    return Starlette(routes=routes, middleware=[Middleware(SafeHeaders), Middleware(KnownHost)])


class _Asked(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    what: Annotated[str, msgspec.Meta(max_length=16)]
    value: Annotated[float, msgspec.Meta(ge=0.0, le=1e6)] = 0.0


def _who(request: Request) -> str:
    return f"{request.client.host if request.client else 'somebody'} over the web page"


def _before(request: Request) -> tuple[int, float] | None:
    """Return incarnation and deadline of a command in the rig's time, None if not given."""
    said = _BEFORE.fullmatch(request.headers.get(_BEFORE_HEADER, ""))
    return (int(said[1]), float(said[2])) if said else None


async def _short(request: Request) -> bytes:
    """Return the body of a request up to the longest order."""
    data = b""
    async for part in request.stream():
        data += part
        if len(data) > _ORDER_BYTES:
            break
    return data[: _ORDER_BYTES + 1]


async def stream_states(context: PageContext) -> AsyncIterator[bytes]:
    """Yield the newest state five times a second, once there is one, as server-sent events."""
    # A slow client only delays itself here; it then gets the newest state, never a queue of old ones.
    yield b"retry: 1000\n\n"
    while not context.closing:
        if latest := context.latest:
            yield b"event: state\ndata: " + latest + b"\n\n"
        await asyncio.sleep(JUDGEMENT_S)


class _Endpoints:
    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._scenario: str | None = None
        with contextlib.suppress(ConfigError):  # reported by the training process
            made_of = scenario_of(context.scene, context.rig.training.scenario)
            self._scenario = made_of.name if made_of else None

    async def index(self, request: Request) -> Response:
        """Return the page with the rig's data in it, which saves its first request."""
        try:
            text = (self._context.dist / "index.html").read_text(encoding="utf-8")
        except (FileNotFoundError, NotADirectoryError):
            return HTMLResponse(_NOT_BUILT, 503)
        told = json.dumps(self._told(request)).replace("<", "\\u003c")  # so that no name ends the script element
        headers = {**_NOT_KEPT, "Content-Security-Policy": policy_of_files(self._picture_source(request))}
        return HTMLResponse(text.replace(UNTOLD, f"{UNTOLD[: -len('null')]}{told}", 1), headers=headers)

    async def state(self, _request: Request) -> Response:
        if not self._context.latest:
            return JSONResponse({"error": "the supervisor has said nothing yet"}, 503, headers={"Retry-After": "1"})
        return Response(self._context.latest, media_type="application/json")

    async def events(self, _request: Request) -> Response:
        return StreamingResponse(stream_states(self._context), media_type="text/event-stream", headers=_NOT_KEPT)

    async def rig(self, request: Request) -> Response:
        return JSONResponse(self._told(request))

    def _told(self, request: Request) -> dict[str, object]:
        """Return the rig's data for the page, for a request under the given host name."""
        rig, host = self._context.rig, host_of(request.headers.get("host"))
        host = f"[{host}]" if ":" in host else host
        return {
            "name": rig.name,
            "scene": self._context.scene,
            "viewer": rig.visualization.viewer,
            "view_ws": f"{self._scheme}://{host}:{self._context.view_port()}/ws",
            "hands": rig.page_hands(),
            "token_needed": True,
            "scenarios": scenario_names(),
            "scenario": self._scenario,
            "switches": self._context.switches,
            "goes_on_from": rig.replay.file.name if rig.replay is not None else "",
            "contracts": rig.contracts.model_dump(mode="json"),
        }

    @property
    def _scheme(self) -> str:
        """Scheme of the picture's WebSocket: it is encrypted where the page is."""
        return "ws" if self._context.rig.supervisor.web.keys is None else "wss"

    def _picture_source(self, request: Request) -> str:
        """Return where the page may connect to for the picture: this host, at whatever port it comes to serve."""
        host = host_of(request.headers.get("host"))
        return f"{self._scheme}://{host}:*" if _PLAIN_HOST.fullmatch(host) else f"{self._scheme}:"

    async def arm(self, request: Request) -> Response:
        return self._refusal(request) or await self._ask_supervisor(request, "arm")

    async def safe_stop(self, request: Request) -> Response:
        return self._refusal(request) or await self._ask_supervisor(request, "safe_stop")

    async def attempt(self, request: Request) -> Response:
        """Pass on an order, ``{"what": "slow", "value": 0.25}``, and wait for the training process' answer."""
        if (refusal := self._refusal(request)) is not None:
            return refusal
        try:
            asked = msgspec.json.decode(await _short(request), type=_Asked)
        except msgspec.DecodeError as error:
            return JSONResponse({"error": f"the order cannot be read: {error}"}, 400)
        order = bodies.Order(id=secrets.randbits(53), what=asked.what, value=asked.value)
        return await self._ask_supervisor(request, "attempt", order)

    async def replay(self, request: Request) -> Response:
        """Pass on a command for `trocar replay --pictures`; it moves no arm and needs no token.

        It requires a header that pages of other sites cannot send.
        """
        if _REPLAY_HEADER not in request.headers:
            return JSONResponse({"error": f"the header {_REPLAY_HEADER} is missing"}, 403)
        line = (await _short(request))[:_LINE_BYTES].decode("ascii", "replace")
        if not self._context.replays():
            return JSONResponse({"error": "no recording is shown here: `trocar replay FILE --pictures` shows one"}, 409)
        return await self._asked(Command(what="replay", who=_who(request), line=line))

    async def scenario(self, request: Request) -> Response:
        """End the present run and start the scenario named in the body, at this address."""
        if (refusal := self._refusal(request) or self._no_switch()) is not None:
            return refusal
        name = (await _short(request)).decode("utf-8", "replace")
        if name not in (known := scenario_names()):
            return JSONResponse({"error": f"there is no scenario {name[:64]!r}; known: {', '.join(known)}"}, 400)
        return await self._ask_supervisor(request, "switch", line=name)

    async def restart(self, request: Request) -> Response:
        """End the present run and start another with what its files say now, at this address; for an instructor."""
        if self._role(request) != "instructor":
            return JSONResponse({"error": "only an instructor, with the class's token, may start the rig anew"}, 403)
        return self._no_switch() or await self._ask_supervisor(request, "restart")

    async def take_over(self, request: Request) -> Response:
        """End the present run, and run a recording of this rig again up to a tick, at which hands take over.

        The body is the recording's name, the tick and the attempt's scenario.
        """
        if (refusal := self._refusal(request) or self._no_switch()) is not None:
            return refusal
        line = (await _short(request)).decode("utf-8", "replace")
        if (asked := _MOMENT.fullmatch(line)) is None or asked[3] not in scenario_names():
            return JSONResponse({"error": "a recording, a tick and a scenario must be named"}, 400)
        if not (self._context.rig.recorder.directory / asked[1]).is_file():
            return JSONResponse({"error": f"the recording {asked[1]} is not at this rig"}, 409)
        return await self._ask_supervisor(request, "take_over", line=line)

    def _no_switch(self) -> Response | None:
        if self._context.switches:
            return None
        return JSONResponse({"error": "this rig cannot be switched: it was not started by `trocar up`"}, 409)

    async def _ask_supervisor(
        self, request: Request, what: What, order: bodies.Order | None = None, line: str = ""
    ) -> Response:
        """Pass on a command, and wait for its outcome."""
        if (before := _before(request)) is None:
            text = f"the header {_BEFORE_HEADER} must say of which run of the rig, and up to when: /api/state has both"
            return JSONResponse({"error": text}, 400)
        incarnation, before_s = before
        return await self._asked(
            Command(what=what, who=_who(request), incarnation=incarnation, before_s=before_s, order=order, line=line)
        )

    async def _asked(self, command: Command) -> Response:
        """Return the outcome of a command."""
        try:
            answer = await asyncio.to_thread(self._context.ask, command)
        except BusError as error:
            return JSONResponse({"error": str(error)}, 504)
        if answer.ok:
            return JSONResponse({"ok": True, "text": answer.text})
        return JSONResponse({"error": answer.text}, 409)

    async def school(self, request: Request) -> Response:
        """Pass a request on to the school's process, with the role that its token gives."""
        role = self._role(request)
        if not role:
            return JSONResponse({"error": "the header X-Trocar-Token must carry the token that the rig printed"}, 403)
        return await pass_on(request, socket_path(self._context.rig.transport), role)

    def _role(self, request: Request) -> str:
        """Return who asks by the token: an instructor, a trainee, or nobody.

        Where there is no class, who has the rig's token is alone with it, and an instructor, too.
        """
        given, context = request.headers.get("X-Trocar-Token", "").encode(), self._context
        if context.class_token and secrets.compare_digest(given, context.class_token.encode()):
            return "instructor"
        if not secrets.compare_digest(given, context.token.encode()):
            return ""
        return "trainee" if context.class_token else "instructor"

    def _refusal(self, request: Request) -> Response | None:
        if not self._role(request):
            return JSONResponse({"error": "the header X-Trocar-Token must carry the token that the rig printed"}, 403)
        return None

    async def metrics(self, request: Request) -> Response:
        registries = self._context.registries
        chosen = registries.get(request.query_params.get("level", "summary"))
        if chosen is None:
            return PlainTextResponse(f"there is no such level; known: {', '.join(registries)}", 400)
        text = prometheus_client.generate_latest(chosen)
        return Response(text, media_type=prometheus_client.CONTENT_TYPE_LATEST)

    async def healthz(self, _request: Request) -> Response:
        ok, words = self._context.healthy()
        return JSONResponse({"ok": ok, "state": words}, 200 if ok else 503)
