"""A rig's settings for its page: files, logs, disk, devices, and the check of a new start; for an instructor only."""

from __future__ import annotations

from typing import Any, NamedTuple

from starlette.requests import Request
from starlette.routing import Route

from trocar.review.journal import ActJournal
from trocar.review.school.answering import PageQuery, answering
from trocar.review.settings.files import ConfigurationFiles
from trocar.review.settings.host import Host
from trocar.review.settings.yaml_edit import with_value


class EditableSettings(NamedTuple):
    """What may be set and looked at."""

    files: ConfigurationFiles
    host: Host


def settings_routes(settings: EditableSettings, journal: ActJournal) -> list[Route]:
    """Return the routes under ``/settings``; each file that is saved is an act in the journal."""
    files, host = settings

    def listed(_request: Request, _ask: PageQuery) -> object:
        return {"files": files.names(), "running": host.told()}

    def opened(request: Request, _ask: PageQuery) -> object:
        kind, name = request.path_params["kind"], request.path_params["name"]
        return files.read(kind, name)._asdict()

    def check(_request: Request, ask: PageQuery) -> object:
        return {"rows": files.check(ask.kind, ask.name, ask.text)}

    def edit(_request: Request, ask: PageQuery) -> object:
        return {"text": with_value(ask.text, ask.key, str(ask.value))}

    def save(_request: Request, ask: PageQuery) -> object:
        mark, rows = files.save(ask.kind, ask.name, ask.text, ask.mark)
        journal.write({"by": ask.by, "act": "settings", "kind": ask.kind, "name": ask.name})
        return {"mark": mark, "rows": rows}

    def check_start(_request: Request, ask: PageQuery) -> object:
        host.check_start()
        journal.write({"by": ask.by, "act": "restart"})
        return {"ok": True}

    asked: dict[str, Any] = {
        "": listed,
        "/logs": lambda _r, _a: host.logs(),
        "/logs/{name}": lambda r, _a: host.log(r.path_params["name"]),
        "/disk": lambda _r, _a: host.disk(),
        "/devices": lambda _r, _a: host.devices(),
        "/files/{kind}/{name}": opened,
    }
    acts: dict[str, Any] = {"/check": check, "/edit": edit, "/save": save, "/start": check_start}
    return [
        *(Route(f"/settings{path}", answering(call, desk=True)) for path, call in asked.items()),
        *(Route(f"/settings{path}", answering(call, desk=True), methods=["POST"]) for path, call in acts.items()),
    ]
