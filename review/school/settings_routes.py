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
from trocar.services.runtime.errors import UserError

FELT_TEST = "felt test"
#: Steps of a felt test that a person answers, and may say no to.
FELT_STEPS = ("follows", "force", "stop")
_ACTS = 10_000  # of the journal, looked through for the newest test of each arm: years of an instructor's acts


class EditableSettings(NamedTuple):
    """What may be set and looked at."""

    files: ConfigurationFiles
    host: Host


def settings_routes(settings: EditableSettings, journal: ActJournal) -> list[Route]:
    """Return the routes under ``/settings``; each file saved and each felt test is an act in the journal."""
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

    def newest_tests(_request: Request, _ask: PageQuery) -> object:
        acts = [act for act in reversed(journal.last(_ACTS)) if act.get("act") == FELT_TEST]
        return {act["arm"]: {key: act[key] for key in ("at_ns", "passed", "step")} for act in acts}

    def keep_test(request: Request, ask: PageQuery) -> object:
        arms = [each["name"] for each in host.told()["instruments"]]
        if ask.name not in arms:
            raise UserError(f"this rig has no arm {ask.name[:64]!r}; it has: {', '.join(arms)}")
        if not isinstance(ask.value, bool) or (ask.key in FELT_STEPS) == ask.value:
            raise UserError(f"a felt test passes, or fails at one of {', '.join(FELT_STEPS)}")
        journal.write({"by": ask.by, "act": FELT_TEST, "arm": ask.name, "passed": ask.value, "step": ask.key})
        return newest_tests(request, ask)

    asked: dict[str, Any] = {
        "": listed,
        "/logs": lambda _r, _a: host.logs(),
        "/logs/{name}": lambda r, _a: host.log(r.path_params["name"]),
        "/disk": lambda _r, _a: host.disk(),
        "/devices": lambda _r, _a: host.devices(),
        "/felt": newest_tests,
        "/files/{kind}/{name}": opened,
    }
    acts: dict[str, Any] = {"/check": check, "/edit": edit, "/save": save, "/start": check_start, "/felt": keep_test}
    return [
        *(Route(f"/settings{path}", answering(call, desk=True)) for path, call in asked.items()),
        *(Route(f"/settings{path}", answering(call, desk=True), methods=["POST"]) for path, call in acts.items()),
    ]
