"""An instructor's acts from the class page: to one bench or to all, side by side, each written into a journal.

A bench takes them by the token of the class (`supervisor.web.class_token`), and only for the run that was seen.
"""

from __future__ import annotations

import http.client
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal

import msgspec

from trocar.review.classroom.watch import Watch
from trocar.review.journal import ActJournal
from trocar.services.runtime.errors import UserError
from trocar.services.runtime.web.web_client import open_connection

_PATIENCE_S, _BEFORE_S = 6.0, 3.0  # a rig answers within 2.5 s; a network and its page have as long again
_ANSWER_BYTES = 1 << 16  # far longer than any sentence, as it may be endless
_AT_ONCE = 16  # a class, so that all rigs are stopped at the same moment
What = Literal["order", "scenario", "arm", "safe_stop", "course", "message", "enter"]


class Act(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An act: on the named rigs, or on all if none is named.

    `word` is the order, the scenario, the course, the message or the trainee; `value` is that of an order.
    """

    what: What
    rigs: tuple[str, ...] = ()
    word: str = ""
    value: float = 0.0
    by: str = "instructor"


class Outcome(msgspec.Struct, frozen=True):
    """What became of an act at a bench."""

    rig: str
    ok: bool
    text: str


class Desk:
    """Carries out acts; a bench that does not answer delays no other."""

    def __init__(self, journal: Path) -> None:
        self.journal = ActJournal(journal)

    def carry_out(self, act: Act, watches: Sequence[Watch], token: str) -> list[Outcome]:
        """Carry out an act at the benches that it names; return what became of it at each.

        Raises UserError if there is no such bench.
        """
        known = {each.place.name: each for each in watches}
        wrong = [name for name in act.rigs if name not in known]
        if wrong:
            raise UserError(f"there is no rig {wrong[0]!r}; known: {', '.join(known)}")
        chosen = [known[name] for name in act.rigs] if act.rigs else list(watches)
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            outcomes = list(pool.map(lambda watch: _at(watch, act, token), chosen))
        self.journal.write({**msgspec.to_builtins(act), "outcomes": msgspec.to_builtins(outcomes)})
        return outcomes


def _at(watch: Watch, act: Act, token: str) -> Outcome:
    """Carry out an act at one bench."""
    name = watch.place.name
    try:
        path, body = _request(watch, act)
        status, said = post(watch, path, body, token)
    except (OSError, http.client.HTTPException, ValueError) as error:
        return Outcome(name, False, f"does not answer: {getattr(error, 'strerror', None) or error}")
    return Outcome(name, status == 200, str(said.get("text") or said.get("error") or "done"))


def _request(watch: Watch, act: Act) -> tuple[str, bytes]:
    trainee = watch.place.trainee
    match act.what:
        case "order":
            return "/api/attempt", msgspec.json.encode({"what": act.word, "value": act.value})
        case "scenario":
            return "/api/scenario", act.word.encode()
        case "course":
            return "/school/course", msgspec.json.encode({"course": act.word, "trainee": trainee})
        case "message":
            return "/school/message", msgspec.json.encode({"words": act.word, "by": act.by})
        case "enter":
            return "/school/enter", msgspec.json.encode({"trainee": act.word or trainee})
        case _:
            return f"/api/{act.what}", b""


def post(watch: Watch, path: str, body: bytes, token: str) -> tuple[int, Mapping[str, Any]]:
    """Send a request to a bench; return status and answer.

    Raises OSError, HTTPException or ValueError if there is none.
    """
    link = open_connection(watch.place.address, _PATIENCE_S, watch.place.fingerprint)
    try:
        incarnation, t = watch.run_time()
        headers = {"X-Trocar-Token": token, "X-Trocar-Before": f"{incarnation} {t + _BEFORE_S:.3f}"}
        link.request("POST", path, body, headers)
        answer = link.getresponse()
        said = msgspec.json.decode(answer.read(_ANSWER_BYTES))
        return answer.status, said if isinstance(said, dict) else {}
    finally:
        link.close()


def live_picture(watch: Watch, token: str) -> bytes:
    """Return the picture that the bench's page shows now. Raises UserError if it shows none."""
    link = open_connection(watch.place.address, _PATIENCE_S, watch.place.fingerprint)
    try:
        link.request("GET", "/school/picture", headers={"X-Trocar-Token": token})
        answer = link.getresponse()
        data = answer.read(1 << 21)
        if answer.status != 200:
            raise UserError("nobody has this bench's page open")
        return data
    except (OSError, http.client.HTTPException) as error:
        raise UserError(f"no picture: {error}") from None
    finally:
        link.close()
