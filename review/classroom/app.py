"""The class page's server: the rigs as they stand, a picture on demand, both for who has the token of the class."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from functools import partial
from pathlib import Path

import msgspec
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.types import ASGIApp, Receive, Scope, Send

from trocar.review.classroom.desk import Act, Desk, live_picture
from trocar.review.classroom.roll import ClassRig, load_roll
from trocar.review.classroom.scores import Scores
from trocar.review.classroom.watch import Watch
from trocar.review.school.answering import Handler, as_instructor
from trocar.review.school.app import build_app as build_school
from trocar.review.school.bench import Bench
from trocar.review.school.courses import course_names
from trocar.services.messages.page_style import speaking, styled
from trocar.services.runtime.errors import UserError
from trocar.services.runtime.web.web_headers import SafeHeaders, policy_of_text
from trocar.services.runtime.web.web_host import KnownHost, listen
from trocar.services.runtime.web.web_server import make_server
from trocar.services.training.scenario import scenario_names

#: Nobody else reads the class page, and no browser keeps it.
_ALONE = {
    "x-frame-options": "DENY",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
_PAGE = Path(__file__).with_name("page.html")
_WORDS = Path(__file__).with_name("words.de.json")


class Classroom:
    """The rigs of a file, which may change while it runs: rigs that stay are followed on."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._file_remark = ""
        self._changed_ns: int | None = None
        self._watches: dict[ClassRig, Watch] = {}
        self.roll = load_roll(file)
        self._scores = Scores(lambda: self.roll)
        self.desk = Desk(file.with_suffix(".journal"))
        self.school = Bench(self.roll.database, journal=file.with_suffix(".school.journal"))
        self._follow_rigs()

    @property
    def watches(self) -> list[Watch]:
        """What follows the rigs, in the order of the file."""
        return list(self._watches.values())

    def _follow_rigs(self) -> None:
        """Follow the rigs that the file names, and no others."""
        self._changed_ns = self._written_ns()
        for place in self._watches.keys() - set(self.roll.rig):
            self._watches.pop(place).close()
        self._watches = {place: self._watches.get(place) or Watch(place, self._scores.of) for place in self.roll.rig}

    def _written_ns(self) -> int | None:
        try:
            return self._file.stat().st_mtime_ns
        except OSError:
            return None

    @property
    def remark(self) -> str:
        """What is wrong with the file or the database, empty if nothing is."""
        return "; ".join(said for said in (self._file_remark, self._scores.remark) if said)

    def look(self) -> None:
        """Read the file again if it has changed; one that cannot be used changes nothing, and is told."""
        written_ns = self._written_ns()
        if written_ns in (None, self._changed_ns):
            return
        try:
            self.roll = load_roll(self._file)
            self._follow_rigs()
            self._scores.ask_store()
            self._file_remark = ""
        except UserError as error:
            self._changed_ns = written_ns
            self._file_remark = str(error)

    def watch(self, name: str) -> Watch | None:
        """Return what follows the rig of a name."""
        return next((each for place, each in self._watches.items() if place.name == name), None)

    def told(self) -> bytes:
        """Return the class as JSON."""
        return msgspec.json.encode({"remark": self.remark, "rigs": [each.row() for each in self._watches.values()]})

    def close(self) -> None:
        """Follow nobody any more."""
        self._scores.close()
        for watch in self._watches.values():
            watch.close()


def build_app(classroom: Classroom) -> Starlette:
    """Return the web application."""
    html = speaking(styled(_PAGE.read_text(encoding="utf-8")), _WORDS)

    async def page(_request: Request) -> Response:
        return HTMLResponse(html)

    async def state(_request: Request) -> Response:
        classroom.look()
        return Response(classroom.told(), media_type="application/json")

    def picture_of(take: Callable[[Watch], bytes], kind: str) -> Handler:
        async def handle(request: Request) -> Response:
            watch = classroom.watch(request.path_params["name"])
            if watch is None:
                return JSONResponse({"error": "there is no such rig"}, 404)
            try:
                image = await run_in_threadpool(take, watch)
            except UserError as error:
                return JSONResponse({"error": str(error)}, 503)
            return Response(image, media_type=kind)

        return handle

    async def act(request: Request) -> Response:
        try:
            asked = msgspec.json.decode(await request.body(), type=Act)
            done = await run_in_threadpool(classroom.desk.carry_out, asked, classroom.watches, classroom.roll.token)
        except msgspec.DecodeError as error:
            return JSONResponse({"error": f"the act cannot be read: {error}"}, 400)
        except UserError as error:
            return JSONResponse({"error": str(error)}, 409)
        return Response(msgspec.json.encode({"outcomes": done}), media_type="application/json")

    async def journal(_request: Request) -> Response:
        return Response(msgspec.json.encode(classroom.desk.journal.last()), media_type="application/json")

    async def choices(_request: Request) -> Response:
        return JSONResponse({"scenarios": scenario_names(), "courses": course_names()})

    def live(watch: Watch) -> bytes:
        return live_picture(watch, classroom.roll.token)

    for_class = partial(_for_class, classroom)
    routes = [
        Route("/", page), Route("/api/class", for_class(state)),
        Route("/api/picture/{name}", for_class(picture_of(Watch.picture, "image/png"))),
        Route("/api/live/{name}", for_class(picture_of(live, "image/jpeg"))),
        Route("/api/act", for_class(act), methods=["POST"]), Route("/api/journal", for_class(journal)),
        Route("/api/choices", choices), Mount("/school", _as_instructor(classroom)),
    ]  # fmt: skip
    policy = policy_of_text(html, "connect-src 'self'", "img-src blob:")
    headers = Middleware(SafeHeaders, policy=policy, also=_ALONE)
    return Starlette(routes=routes, middleware=[headers, Middleware(KnownHost)])


def serve(file: Path, host: str, port: int) -> None:
    """Serve the class until Ctrl-C. Raises UserError if the file cannot be used, or the port is taken."""
    classroom = Classroom(file)
    sock = listen(host, port, "--port N")
    shown = sock.getsockname()
    print(f"the class: open http://{shown[0]}:{shown[1]}/#token={classroom.roll.token}", flush=True)  # noqa: T201
    try:
        make_server(build_app(classroom)).run(sockets=[sock])
    finally:
        classroom.close()


def _refusal(classroom: Classroom, request: Request) -> Response | None:
    """Return what a request without the token of the class is told; None if it has it."""
    given = request.headers.get("X-Trocar-Token", "")
    if secrets.compare_digest(given.encode(), classroom.roll.token.encode()):
        return None
    return JSONResponse({"error": "the token of the class is needed"}, 403)


def _for_class(classroom: Classroom, handler: Handler) -> Handler:
    """Return a handler of requests that have the token of the class."""

    async def handle(request: Request) -> Response:
        return _refusal(classroom, request) or await handler(request)

    return handle


def _as_instructor(classroom: Classroom) -> ASGIApp:
    """Return the school of the class; a request with the token of the class is an instructor's."""
    school = build_school(classroom.school)

    async def pass_on(scope: Scope, receive: Receive, send: Send) -> None:
        refusal = _refusal(classroom, Request(scope)) if scope["type"] == "http" else None
        if refusal is None and classroom.roll.database is None:
            refusal = JSONResponse({"error": "the file of the class names no `database`"}, 409)
        if refusal is not None:
            await refusal(scope, receive, send)
            return
        await school(as_instructor(scope), receive, send)

    return pass_on
