"""The school's web application, behind the page's server, which has checked whether a trainee or an instructor asks."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

import msgspec
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from trocar.review.school.bench import Bench
from trocar.review.school.replays import MOST_BYTES
from trocar.review.school.reports import SCALES
from trocar.services.runtime.errors import UserError

#: Set by the page's server: who asks.
ROLE = "x-trocar-role"
_WORDS_BYTES, _PICTURE_BYTES = 1 << 16, 1 << 20
_KINDS = {"csv": "text/csv", "json": "application/json", "xapi": "application/json"}
#: That a database can have given to an attempt.
_LARGEST_NUMBER = 2**63 - 1
Handler = Callable[[Request], Awaitable[Response]]


class Ask(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a page asks for; each request takes what it needs of it."""

    trainee: str = ""
    pin: str = ""
    course: str = ""
    scale: str = ""
    points: dict[str, int] = {}
    at_s: float = 0.0
    words: str = ""
    by: str = "instructor"
    kind: str = ""
    value: str | bool = ""
    recordings: bool = False


def build_app(bench: Bench) -> Starlette:
    """Return the application."""
    return Starlette(routes=[*_trainee_routes(bench), *_file_routes(bench), *_desk_routes(bench)])


def _trainee_routes(bench: Bench) -> list[Route]:
    """Return what a trainee asks for: who trains, in which course, attempts and curve."""

    def enter(_request: Request, ask: Ask) -> object:
        bench.enter(ask.trainee or bench.new_name(), ask.pin)
        return bench.state()

    def leave(_request: Request, _ask: Ask) -> object:
        bench.leave()
        return bench.state()

    def choose(request: Request, ask: Ask) -> object:
        by = request.headers.get(ROLE, "trainee")
        bench.choose(ask.course, by, ask.trainee if by == "instructor" else "")
        return bench.state()

    def curve(request: Request, _ask: Ask) -> object:
        query = request.query_params
        return bench.curve(query.get("trainee", ""), query.get("scenario", ""))

    return [
        Route("/state", _answering(lambda _r, _a: bench.state())),
        Route("/pulse", _answering(lambda _r, _a: bench.pulse())),
        Route("/name", _answering(lambda _r, _a: {"name": bench.new_name()})),
        Route("/enter", _answering(enter), methods=["POST"]),
        Route("/leave", _answering(leave), methods=["POST"]),
        Route("/course", _answering(choose), methods=["POST"]),
        Route("/attempts", _answering(lambda r, _a: bench.listed(r.query_params.get("trainee", "")))),
        Route("/attempts/{number:int}", _answering(lambda r, _a: bench.report(_number(r)))),
        Route("/curve", _answering(curve)),
        Route("/ghost/{scenario}", _answering(lambda r, _a: {"attempt_id": bench.ghost(r.path_params["scenario"])})),
        Route("/scales", _answering(lambda _r, _a: SCALES)),
    ]


def _file_routes(bench: Bench) -> list[Route]:
    """Return the pictures and replays that a page brings and gets back."""

    async def replay(request: Request) -> Response:
        attempt_id = request.path_params["attempt_id"]
        if request.method == "PUT":
            data = await _body(request, MOST_BYTES)
            await run_in_threadpool(bench.replays.keep, attempt_id, data)
            return _json({"ok": True})
        data = await run_in_threadpool(bench.replays.path(attempt_id).read_bytes)
        return Response(data, media_type="application/octet-stream")

    async def last_picture(request: Request) -> Response:
        attempt_id = request.path_params["attempt_id"]
        if request.method == "PUT":
            bench.replays.keep_picture(attempt_id, await _body(request, _PICTURE_BYTES))
            return _json({"ok": True})
        return Response(bench.replays.picture(attempt_id).read_bytes(), media_type="image/jpeg")

    async def picture(request: Request) -> Response:
        if request.method == "PUT":
            bench.show(await _body(request, _PICTURE_BYTES))
            return _json({"ok": True})
        if request.headers.get(ROLE) != "instructor":
            return _json({"error": "only an instructor may look"}, 403)
        image = bench.picture()
        return _json({"error": "no page is open"}, 404) if image is None else Response(image, media_type="image/jpeg")

    return [
        Route("/picture", _with_files(picture), methods=["GET", "PUT"]),
        Route("/last-picture/{attempt_id}", _with_files(last_picture), methods=["GET", "PUT"]),
        Route("/replay/{attempt_id}", _with_files(replay), methods=["GET", "PUT"]),
    ]


def _with_files(handle: Handler) -> Handler:
    """Return a handler that says why a file cannot be taken or given."""

    async def answer(request: Request) -> Response:
        try:
            return await handle(request)
        except FileNotFoundError:
            return _json({"error": "this attempt has no pictures: no page saw it"}, 404)
        except UserError as error:
            return _json({"error": str(error)}, 400)
        except OSError as error:
            return _json({"error": f"the pictures cannot be kept or read: {error.strerror or error}"}, 507)

    return answer


def _desk_routes(bench: Bench) -> list[Route]:
    """Return what only an instructor may do."""

    def done(act: Callable[[Ask, Request], object]) -> Handler:
        def call(request: Request, ask: Ask) -> object:
            act(ask, request)
            return {"ok": True}

        return _answering(call, desk=True)

    def export(request: Request, _ask: Ask) -> Response:
        form = request.path_params["form"]
        if form not in _KINDS:
            raise UserError(f"{form!r} is no form of export; known: {', '.join(_KINDS)}")
        return Response(bench.export(form, request.query_params.get("trainee")), media_type=_KINDS[form])

    acts: dict[str, Callable[[Ask, Request], object]] = {
        "/attempts/{number:int}/rating": lambda a, r: bench.rate(_number(r), a.scale, a.points, a.by),
        "/attempts/{number:int}/bookmark": lambda a, r: bench.bookmark(_number(r), a.at_s, a.words, a.by),
        "/mark": lambda a, _r: bench.mark(a.trainee, a.kind, a.value, a.by),
        "/message": lambda a, _r: bench.say(a.words, a.by),
        "/erase": lambda a, _r: bench.erase(a.trainee, a.by, recordings=a.recordings),
    }
    return [
        Route("/class", _answering(lambda _r, _a: bench.table(), desk=True)),
        Route("/journal", _answering(lambda _r, _a: bench.journal.last(), desk=True)),
        Route("/export/{form}", _answering(export, desk=True)),
        *(Route(path, done(act), methods=["POST"]) for path, act in acts.items()),
    ]


def _answering(call: Callable[[Request, Ask], Any], *, desk: bool = False) -> Handler:
    """Return a handler that answers with what a call returns, or says why not; `desk`: to an instructor only."""

    async def handle(request: Request) -> Response:
        if desk and request.headers.get(ROLE) != "instructor":
            return _json({"error": "the token of the class is needed: only an instructor may do this"}, 403)
        try:
            text = await _body(request, _WORDS_BYTES)
            ask = msgspec.json.decode(text, type=Ask) if text else Ask()
            found = await run_in_threadpool(call, request, ask)
        except msgspec.DecodeError as error:
            return _json({"error": f"the request cannot be read: {error}"}, 400)
        except UserError as error:
            return _json({"error": str(error)}, 409)
        return found if isinstance(found, Response) else _json(found)

    return handle


def _json(value: object, status: int = 200) -> Response:
    return Response(msgspec.json.encode(value), status, media_type="application/json")


def _number(request: Request) -> int:
    number = int(request.path_params["number"])
    if number > _LARGEST_NUMBER:
        raise UserError("there is no attempt of that number")
    return number


async def _body(request: Request, most: int) -> bytes:
    data = bytearray()
    async for part in request.stream():
        data += part
        if len(data) > most:
            raise UserError(f"more than {most} bytes are not taken")
    return bytes(data)
