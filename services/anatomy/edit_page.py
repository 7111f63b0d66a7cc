"""A page on this machine that shows a duct and takes what a person picks with the mouse."""

from __future__ import annotations

import asyncio
import json
import secrets
import threading
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request as HttpRequest
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from trocar.services.anatomy.making import AnatomyRequest, MadeAnatomy, propose, rounded_mm
from trocar.services.meshes.errors import MeshError
from trocar.services.runtime.web.web_host import KnownHost, listen
from trocar.services.runtime.web.web_server import make_server, serve_until

HOST = "127.0.0.1"
_MOST_BYTES = 100_000
_FILES = {"anatomy.html": "text/html", "anatomy.js": "text/javascript", "anatomy.css": "text/css"}
Save = Callable[[MadeAnatomy], None]


class EditPage:
    """The page's application.

    Attributes:
        made: What is shown, with the picks that were saved last.
        token: Whoever has it may look and save: other pages of the same browser do not.

    Args:
        save: Called with what was picked, to write it.
        files: The folder of the built page.
    """

    def __init__(self, made: MadeAnatomy, save: Save, files: Path) -> None:
        self.made, self._save, self._files = made, save, files
        self.token = secrets.token_urlsafe(16)
        self._ended = threading.Event()
        self.app = Starlette(
            routes=[
                Route("/", self._page),
                Route("/{name}", self._file, methods=["GET"]),
                Route("/api/duct", self._duct, methods=["GET"]),
                Route("/api/save", self._take, methods=["POST"]),
                Route("/api/end", self._end, methods=["POST"]),
            ],
            middleware=[Middleware(KnownHost)],
        )

    def serve(self, port: int, on_address: Callable[[str], None]) -> None:
        """Serve until the page is told to end, or Ctrl-C; a port of 0 takes a free one.

        Raises BusError if the port is taken.
        """
        with closing(listen(HOST, port, "--port N")) as listener:
            on_address(f"http://{HOST}:{listener.getsockname()[1]}/?token={self.token}")
            asyncio.run(serve_until(make_server(self.app), listener, self._ended.is_set))

    def end(self) -> None:
        """End serving; from any thread."""
        self._ended.set()

    def _admit(self, request: HttpRequest) -> None:
        """Refuse who does not have the token."""
        given = request.query_params.get("token", "")
        if not secrets.compare_digest(given.encode(), self.token.encode()):
            raise HTTPException(403, "open the address that `trocar anatomy --edit` printed")

    async def _page(self, request: HttpRequest) -> Response:
        self._admit(request)
        return self._sent("anatomy.html")

    async def _file(self, request: HttpRequest) -> Response:
        return self._sent(request.path_params["name"])

    def _sent(self, name: str) -> Response:
        if name not in _FILES:
            raise HTTPException(404)
        return FileResponse(self._files / name, media_type=_FILES[name], headers={"cache-control": "no-store"})

    async def _duct(self, request: HttpRequest) -> Response:
        self._admit(request)
        return JSONResponse(shown(self.made))

    async def _take(self, request: HttpRequest) -> Response:
        self._admit(request)
        body = await request.body()
        if len(body) > _MOST_BYTES:
            raise HTTPException(413)
        try:
            picked = picked_request(self.made, json.loads(body))
            made = propose(self.made.path, picked, self.made.surface, self.made.wall, self.made.duct)
            self._save(made)
        except (MeshError, ValueError, KeyError, TypeError) as error:
            return JSONResponse({"refused": str(error) or type(error).__name__}, status_code=422)
        self.made = replace(made, seconds=self.made.seconds)
        return JSONResponse(shown(self.made))

    async def _end(self, request: HttpRequest) -> Response:
        self._admit(request)
        self.end()
        return JSONResponse({})


def shown(made: MadeAnatomy) -> dict[str, Any]:
    """Return what the page draws; lengths in mm, places in LPS axes."""
    mesh = made.duct.mesh
    back = [1e3 * (np.array(port) @ made.axes + made.origin_m) for port in made.ports_m]
    return {
        "file": made.path.name,
        "vertices_mm": np.round(1e3 * mesh.vertices_m, 3).ravel().tolist(),
        "triangles": mesh.triangles.ravel().tolist(),
        "lines_mm": [np.round(1e3 * line.points_m, 3).tolist() for line in made.duct.lines],
        "ends": [
            {
                "name": end.name, "at_mm": rounded_mm(end.opening.centre_m),
                "out": np.round(end.opening.direction, 4).tolist(), "width_mm": round(1e3 * end.opening.diameter_m, 2),
                "rim_mm": np.round(1e3 * mesh.vertices_m[end.opening.rim], 3).tolist(),
            }
            for end in made.duct.ends
        ],
        "mouth": made.choice.mouth, "held": list(made.choice.held), "ports_mm": [np.round(p, 2).tolist() for p in back],
        "goal_mm": made.request.goal_mm,
        "goal": None if made.goal is None else {"end": made.goal.end, "depth_mm": round(1e3 * made.goal.depth_m, 1)},
        "catheter": made.duct.catheter,
    }  # fmt: skip


def picked_request(made: MadeAnatomy, picked: dict[str, Any]) -> AnatomyRequest:
    """Return the request with what a person picked: mouth, held, ports_mm, goal_mm, and names by the old ones.

    Raises ValueError or MeshError if a value cannot be.
    """
    names = {str(old): str(new) for old, new in dict(picked.get("names", {})).items() if old != new}
    ports = tuple(_place(port) for port in picked.get("ports_mm") or ())
    goal = picked.get("goal_mm")
    mouth, held = _renamed(picked["mouth"], names), tuple(_renamed(each, names) for each in picked["held"])
    return replace(
        made.request, mouth=mouth, held=held, names=tuple(f"{old}={new}" for old, new in names.items()),
        ports_mm=ports, goal_mm=None if goal is None else _place(goal),
    )  # fmt: skip


def _renamed(name: Any, names: dict[str, str]) -> str:
    return names.get(str(name), str(name))


def _place(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    if not all(abs(value) < 1e4 for value in (x, y, z)):
        raise ValueError(f"no place: {x:g}, {y:g}, {z:g} mm")
    return x, y, z
