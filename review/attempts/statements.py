"""Attempts as xAPI statements (IEEE 9274.1.1), for a learning record store or a file.

A statement's identifier is made of the attempt and its judgement. So one that is sent again is the same statement,
which a store keeps once, and nothing has to be remembered of what was sent.
"""

from __future__ import annotations

import base64
import http.client
import time
import urllib.error
import urllib.request
import uuid
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import Any

import msgspec

from trocar.review.attempts.assessment import Assessment
from trocar.services.runtime.errors import UserError
from trocar.services.runtime.web.web_client import open_url

_NAMESPACE = uuid.UUID("6f1f63a4-0c53-4bb0-9a67-2a1f6f9d7f0e")
_VERBS = "http://adlnet.gov/expapi/verbs/"
_SIMULATION = "http://adlnet.gov/expapi/activities/simulation"
_VERB_OF = {"success": "passed", "failure": "failed"}
#: Statements in one request, and pauses before what failed is tried again, s: each about four times as long as the one
#: before, as a busy store is only held up by more questions.
BATCH, PAUSES_S = 50, (1.0, 5.0, 20.0)
_PATIENCE_S = 30.0  # longer than a store takes for a request, so that nothing is sent twice
_REFUSALS = range(400, 500)
#: Answers by which a store says that it is busy.
_BUSY = 408, 429


def statement(found: Assessment, trainee: str, home: str) -> dict[str, Any]:
    """Return the statement of an attempt.

    Args:
        found: What is known of it.
        trainee: Pseudonym: the name of the actor's account.
        home: Address under which pseudonyms are known: the account's home page.
    """
    verb = _VERB_OF.get(found.outcome, "attempted")
    result: dict[str, Any] = {
        "success": found.outcome == "success",
        "completion": found.outcome in _VERB_OF,
        "duration": f"PT{found.time_s:.3f}S",
        "extensions": {
            f"{home}/trocar/counts": found.counts,
            f"{home}/trocar/errors": _counted(found),
            f"{home}/trocar/metrics": found.metrics,
        },
    }
    if found.score is not None:
        result["score"] = {"raw": found.score.total, "min": 0.0}
        if found.score.percent:
            result["score"]["scaled"] = min(1.0, found.score.percent / 100.0)
    began = datetime.fromtimestamp(found.began_ns * 1e-9 + found.time_s, UTC)
    whole = msgspec.json.encode(found, order="deterministic")
    return {
        "id": str(uuid.uuid5(_NAMESPACE, f"{trainee} {uuid.uuid5(_NAMESPACE, whole.decode())}")),
        "timestamp": began.isoformat(timespec="milliseconds"),
        "actor": {"objectType": "Agent", "account": {"homePage": home, "name": trainee}},
        "verb": {"id": f"{_VERBS}{verb}", "display": {"en": verb}},
        "object": {
            "objectType": "Activity",
            "id": f"{home}/trocar/scenarios/{found.scenario or 'practice'}",
            "definition": {"type": _SIMULATION, "name": {"en": found.title or found.scenario or "practice"}},
        },
        "result": result,
        "context": {"platform": f"Trocar {found.version}"},
    }


def _counted(found: Assessment) -> dict[str, int]:
    counts: dict[str, int] = {}
    for event in found.errors:
        counts[event.code] = counts.get(event.code, 0) + 1
    return counts


def as_lines(statements: Sequence[dict[str, Any]]) -> bytes:
    """Return statements as lines of JSON."""
    return b"".join(msgspec.json.encode(each) + b"\n" for each in statements)


class Endpoint:
    """A learning record store.

    Args:
        address: Where its statements are, such as ``https://lrs.example/xapi/statements``.
        login: ``NAME:PASSWORD``, empty without.
        pause: Waits some seconds.
    """

    def __init__(self, address: str, login: str = "", pause: Callable[[float], object] = time.sleep) -> None:
        self._address, self._pause = address, pause
        self._headers = {"Content-Type": "application/json", "X-Experience-API-Version": "1.0.3"}
        if login:
            self._headers["Authorization"] = f"Basic {base64.b64encode(login.encode()).decode()}"

    def send(self, statements: Sequence[dict[str, Any]]) -> None:
        """Send all of them.

        Raises UserError that says how many arrived, if the store refuses some or cannot be reached; it is safe to send
        all again.
        """
        for begin in range(0, len(statements), BATCH):
            try:
                self._send_batch(statements[begin : begin + BATCH])
            except UserError as error:
                kept = f"{begin} of {len(statements)} attempts arrived"
                raise UserError(f"{self._address}: {error}; {kept}, send them again") from None

    def _send_batch(self, batch: Sequence[dict[str, Any]]) -> None:
        data = msgspec.json.encode(batch)
        for pause_s in (*PAUSES_S, None):
            try:
                fault = self._try_to_post(data)
            except _KnownError:
                # A store may take none of a batch of which it has one; alone, a statement that it has has arrived.
                for each in batch if len(batch) > 1 else ():
                    self._send_batch([each])
                return
            if not fault:
                return
            if pause_s is not None:
                self._pause(pause_s)
        raise UserError(fault)

    def _try_to_post(self, data: bytes) -> str:
        """Return why it has to be tried again, empty if the data arrived.

        Raises UserError if the store refuses it, _KnownError if it has such a statement.
        """
        request = urllib.request.Request(self._address, data, self._headers, method="POST")
        try:
            with open_url(request, _PATIENCE_S) as answer:
                answer.read()
        except urllib.error.HTTPError as error:
            said = error.read(300).decode("utf-8", "replace").strip()
            if error.code == http.HTTPStatus.CONFLICT:
                raise _KnownError from None
            if error.code in _REFUSALS and error.code not in _BUSY:
                raise UserError(f"refuses them: {error.code} {error.reason}{f', {said}' if said else ''}") from None
            return f"answers {error.code} {error.reason}"
        except (OSError, http.client.HTTPException) as error:
            return f"cannot be reached: {getattr(error, 'reason', None) or error}"
        return ""


class _KnownError(Exception):
    """The store has a statement of an identifier already."""
