"""The school's web application, behind the page's server, which has checked whether a trainee or an instructor asks."""

from __future__ import annotations

from collections.abc import Callable

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from trocar.review.school.answering import ROLE, Handler, PageQuery, answering, as_json, body_of
from trocar.review.school.bench import Bench
from trocar.review.school.replays import MOST_BYTES
from trocar.review.school.reports import SCALES
from trocar.review.school.settings_routes import EditableSettings, settings_routes
from trocar.services.runtime.errors import UserError

_PICTURE_BYTES = 1 << 20  # more than a page's picture as JPEG, as it may be endless
_KINDS = {"csv": "text/csv", "json": "application/json", "xapi": "application/json"}
#: That a database can have given to an attempt, as its numbers have 64 bits.
_LARGEST_NUMBER = 2**63 - 1


def build_app(bench: Bench, settings: EditableSettings | None = None) -> Starlette:
    """Return the application, with the settings of the rig if they are given."""
    of_rig = settings_routes(settings, bench.journal) if settings is not None else []
    return Starlette(routes=[*_trainee_routes(bench), *_file_routes(bench), *_desk_routes(bench), *of_rig])


def _trainee_routes(bench: Bench) -> list[Route]:
    """Return what a trainee asks for: who trains, in which course, attempts and curve."""

    def enter(_request: Request, ask: PageQuery) -> object:
        bench.enter(ask.trainee or bench.new_name(), ask.pin)
        return bench.state()

    def leave(_request: Request, _ask: PageQuery) -> object:
        bench.leave()
        return bench.state()

    def choose(request: Request, ask: PageQuery) -> object:
        by = request.headers.get(ROLE, "trainee")
        bench.choose(ask.course, by, ask.trainee if by == "instructor" else "")
        return bench.state()

    def curve(request: Request, _ask: PageQuery) -> object:
        query = request.query_params
        return bench.curve(query.get("trainee", ""), query.get("scenario", ""))

    def cholangiogram(request: Request, _ask: PageQuery) -> object:
        found = bench.cholangiogram(_number(request))
        return as_json({}, 202) if found is None else Response(found, media_type="application/json")

    return [
        Route("/state", answering(lambda _r, _a: bench.state())),
        Route("/pulse", answering(lambda _r, _a: bench.pulse())),
        Route("/name", answering(lambda _r, _a: {"name": bench.new_name()})),
        Route("/enter", answering(enter), methods=["POST"]),
        Route("/leave", answering(leave), methods=["POST"]),
        Route("/course", answering(choose), methods=["POST"]),
        Route("/attempts", answering(lambda r, _a: bench.listed(r.query_params.get("trainee", "")))),
        Route("/attempts/{number:int}", answering(lambda r, _a: bench.report(_number(r)))),
        Route("/attempts/{number:int}/cholangiogram", answering(cholangiogram)),
        Route("/curve", answering(curve)),
        Route("/ghost/{scenario}", answering(lambda r, _a: {"attempt_id": bench.ghost(r.path_params["scenario"])})),
        Route("/scales", answering(lambda _r, _a: SCALES)),
    ]


def _file_routes(bench: Bench) -> list[Route]:
    """Return the pictures and replays that a page brings and gets back."""

    async def replay(request: Request) -> Response:
        attempt_id = request.path_params["attempt_id"]
        if request.method == "PUT":
            data = await body_of(request, MOST_BYTES)
            await run_in_threadpool(bench.replays.keep, attempt_id, data)
            return as_json({"ok": True})
        data = await run_in_threadpool(bench.replays.path(attempt_id).read_bytes)
        return Response(data, media_type="application/octet-stream")

    async def last_picture(request: Request) -> Response:
        attempt_id = request.path_params["attempt_id"]
        if request.method == "PUT":
            bench.replays.keep_picture(attempt_id, await body_of(request, _PICTURE_BYTES))
            return as_json({"ok": True})
        return Response(bench.replays.picture(attempt_id).read_bytes(), media_type="image/jpeg")

    async def picture(request: Request) -> Response:
        if request.method == "PUT":
            bench.show(await body_of(request, _PICTURE_BYTES))
            return as_json({"ok": True})
        if request.headers.get(ROLE) != "instructor":
            return as_json({"error": "only an instructor may look"}, 403)
        image = bench.picture()
        return as_json({"error": "no page is open"}, 404) if image is None else Response(image, media_type="image/jpeg")

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
            return as_json({"error": "this attempt has no pictures: no page saw it"}, 404)
        except UserError as error:
            return as_json({"error": str(error)}, 400)
        except OSError as error:
            return as_json({"error": f"the pictures cannot be kept or read: {error.strerror or error}"}, 507)

    return answer


def _desk_routes(bench: Bench) -> list[Route]:
    """Return what only an instructor may do."""

    def done(act: Callable[[PageQuery, Request], object]) -> Handler:
        def call(request: Request, ask: PageQuery) -> object:
            act(ask, request)
            return {"ok": True}

        return answering(call, desk=True)

    def export(request: Request, _ask: PageQuery) -> Response:
        form = request.path_params["form"]
        if form not in _KINDS:
            raise UserError(f"{form!r} is no form of export; known: {', '.join(_KINDS)}")
        return Response(bench.export(form, request.query_params.get("trainee")), media_type=_KINDS[form])

    acts: dict[str, Callable[[PageQuery, Request], object]] = {
        "/attempts/{number:int}/rating": lambda a, r: bench.rate(_number(r), a.scale, a.points, a.by),
        "/attempts/{number:int}/bookmark": lambda a, r: bench.bookmark(_number(r), a.at_s, a.words, a.by),
        "/mark": lambda a, _r: bench.mark(a.trainee, a.kind, a.value, a.by),
        "/message": lambda a, _r: bench.say(a.words, a.by),
        "/erase": lambda a, _r: bench.erase(a.trainee, a.by, recordings=a.recordings),
    }
    return [
        Route("/class", answering(lambda _r, _a: bench.table(), desk=True)),
        Route("/journal", answering(lambda _r, _a: bench.journal.last(), desk=True)),
        Route("/export/{form}", answering(export, desk=True)),
        *(Route(path, done(act), methods=["POST"]) for path, act in acts.items()),
    ]


def _number(request: Request) -> int:
    number = int(request.path_params["number"])
    if number > _LARGEST_NUMBER:
        raise UserError("there is no attempt of that number")
    return number
