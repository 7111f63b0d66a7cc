"""The class page's server: the rigs as they stand, a picture on demand, both for who has the token of the class."""

from __future__ import annotations

import secrets
from pathlib import Path

import msgspec
import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from trocar.review.attempts.store.attempts import Store
from trocar.review.classroom.roll import ClassRig, load_roll
from trocar.review.classroom.watch import Watch
from trocar.services.runtime.errors import UserError
from trocar.services.runtime.web_host import KnownHost, listen

_PAGE = Path(__file__).with_name("page.html")
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'self' 'unsafe-inline'; img-src 'self' blob:",
}


class Classroom:
    """The rigs of a file, which may change while it runs: rigs that stay are followed on."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self.remark = ""
        self._changed_ns = 0
        self._watches: dict[ClassRig, Watch] = {}
        self._load()

    def _load(self) -> None:
        self._changed_ns = self._file.stat().st_mtime_ns if self._file.exists() else 0
        self.roll = roll = load_roll(self._file)  # before anybody is watched: threads of rigs ask for it at once
        for place in self._watches.keys() - set(roll.rig):
            self._watches.pop(place).close()
        self._watches = {place: self._watches.get(place) or Watch(place, self._last_score) for place in roll.rig}

    def look(self) -> None:
        """Read the file again if it has changed; one that cannot be used changes nothing, and is told."""
        if self._file.exists() and self._file.stat().st_mtime_ns != self._changed_ns:
            try:
                self._load()
                self.remark = ""
            except UserError as error:
                self.remark = str(error)

    def watch(self, name: str) -> Watch | None:
        """Return what follows the rig of a name."""
        return next((each for place, each in self._watches.items() if place.name == name), None)

    def told(self) -> bytes:
        """Return the class as JSON."""
        return msgspec.json.encode({"remark": self.remark, "rigs": [each.row() for each in self._watches.values()]})

    def close(self) -> None:
        """Follow nobody any more."""
        for watch in self._watches.values():
            watch.close()

    def _last_score(self, trainee: str) -> float | None:
        """Return the last score that was kept of a trainee; asked by the threads of rigs."""
        if not trainee or self.roll.database is None:
            return None
        try:
            with Store(self.roll.database) as store:
                return next((row.total for row in reversed(store.listed(trainee)) if row.total is not None), None)
        except UserError as error:
            self.remark = str(error)
            return None


def build_app(classroom: Classroom) -> Starlette:
    """Return the web application."""

    def is_refused(request: Request) -> bool:
        given = request.headers.get("X-Trocar-Token", "")
        return not secrets.compare_digest(given.encode(), classroom.roll.token.encode())

    async def page(_request: Request) -> Response:
        return HTMLResponse(_PAGE.read_text(encoding="utf-8"), headers=_HEADERS)

    async def state(request: Request) -> Response:
        if is_refused(request):
            return JSONResponse({"error": "the token of the class is needed"}, 403)
        classroom.look()
        return Response(classroom.told(), media_type="application/json", headers=_HEADERS)

    async def picture(request: Request) -> Response:
        if is_refused(request):
            return JSONResponse({"error": "the token of the class is needed"}, 403)
        watch = classroom.watch(request.path_params["name"])
        if watch is None:
            return JSONResponse({"error": "there is no such rig"}, 404)
        try:
            image = await run_in_threadpool(watch.picture)
        except UserError as error:
            return JSONResponse({"error": str(error)}, 503)
        return Response(image, media_type="image/png", headers=_HEADERS)

    routes = [Route("/", page), Route("/api/class", state), Route("/api/picture/{name}", picture)]
    return Starlette(routes=routes, middleware=[Middleware(KnownHost)])


def serve(file: Path, host: str, port: int) -> None:
    """Serve the class until Ctrl-C. Raises UserError if the file cannot be used, or the port is taken."""
    classroom = Classroom(file)
    sock = listen(host, port, "--port N")
    shown = sock.getsockname()
    print(f"the class: open http://{shown[0]}:{shown[1]}/#token={classroom.roll.token}", flush=True)  # noqa: T201
    config = uvicorn.Config(build_app(classroom), log_level="warning", access_log=False, lifespan="off", ws="none")
    try:
        uvicorn.Server(config).run(sockets=[sock])
    finally:
        classroom.close()
