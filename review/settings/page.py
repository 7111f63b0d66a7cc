"""The settings without a rig: files, devices, recordings and logs of this host, on the page that a rig would serve.

A rig that does not start serves no page, and its files are what has to be mended.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Sequence
from contextlib import closing, suppress
from pathlib import Path

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send

from trocar.review.journal import ActJournal
from trocar.review.school.answering import as_instructor
from trocar.review.school.replays import folder_of
from trocar.review.school.settings_routes import EditableSettings, settings_routes
from trocar.review.settings.files import ConfigurationFiles
from trocar.review.settings.host import Host
from trocar.services.runtime.config.config import find, load_rig
from trocar.services.runtime.errors import ConfigError
from trocar.services.runtime.web.web_headers import SafeHeaders, policy_of_files
from trocar.services.runtime.web.web_host import KnownHost, listen
from trocar.services.runtime.web.web_server import make_server
from trocar.services.supervisor.page.page_place import DIST
from trocar.services.supervisor.page.web import UNTOLD

HOST = "127.0.0.1"


def build_app(settings: EditableSettings, journal: ActJournal, token: str, dist: Path = DIST) -> Starlette:
    """Return the web application: the built page, and the settings for who has the token.

    Raises ConfigError if the page is not built.
    """
    try:
        html = (dist / "index.html").read_text(encoding="utf-8")
    except (FileNotFoundError, NotADirectoryError):
        raise ConfigError(
            f"the page is not built: {dist} is missing; `python -m trocar.services.visualization.web.build` makes it"
        ) from None
    told = html.replace(UNTOLD, f"{UNTOLD[: -len('null')]}{json.dumps({'settings': True})}", 1)
    headers = {"Cache-Control": "no-store", "Content-Security-Policy": policy_of_files()}

    async def page(_request: Request) -> Response:
        return HTMLResponse(told, headers=headers)

    school = Starlette(routes=settings_routes(settings, journal))
    routes = [
        Route("/", page),
        Mount("/school", _for_token(school, token)),
        Mount("/", StaticFiles(directory=dist)),
    ]
    return Starlette(routes=routes, middleware=[Middleware(SafeHeaders), Middleware(KnownHost)])


def _for_token(school: ASGIApp, token: str) -> ASGIApp:
    """Return an application whose requests must have the token, and are then an instructor's."""

    async def pass_on(scope: Scope, receive: Receive, send: Send) -> None:
        given = Request(scope).headers.get("X-Trocar-Token", "")
        if not secrets.compare_digest(given.encode(), token.encode()):
            text = "the header X-Trocar-Token must carry the token that `trocar settings` printed"
            await JSONResponse({"error": text}, 403)(scope, receive, send)
            return
        await school(as_instructor(scope), receive, send)

    return pass_on


def serve(rig_name: str, scene: str, overrides: Sequence[str], port: int) -> None:
    """Serve until Ctrl-C.

    Raises ConfigError if the page is not built, or there is no such rig or scene, and BusError if the port is taken.
    """
    find("rig", rig_name)
    find("scene", scene)
    rig = None
    with suppress(ConfigError):  # the page shows it, at the file
        rig = load_rig(rig_name, overrides)
    replays, token = folder_of(None), secrets.token_urlsafe(16)
    settings = EditableSettings(
        ConfigurationFiles(), Host(rig, (rig_name, overrides), scene, replays, is_running=False)
    )
    app = build_app(settings, ActJournal(replays.with_suffix(".journal")), token)
    with closing(listen(HOST, port, "--port N")) as sock:
        print(f"the settings: open http://{HOST}:{sock.getsockname()[1]}/#token={token}", flush=True)  # noqa: T201
        make_server(app).run(sockets=[sock])
