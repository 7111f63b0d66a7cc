"""Attempts as xAPI statements (IEEE 9274.1.1), for a learning record store or a file.

A statement's identifier is made of all that it says, and of the attempt. So one that is sent again is the same
statement, which a store keeps once; one that says anything else is another; and nothing has to be remembered of what
was sent. A statement has arrived only where the store says so by its identifier, as the standard wants.
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
from http import HTTPStatus
from typing import Any
from urllib.parse import quote, urlsplit

import msgspec

from trocar.review.attempts.assessment import Assessment
from trocar.services.runtime.errors import ConfigError, UserError
from trocar.services.runtime.web.web_client import open_url

_NAMESPACE = uuid.UUID("6f1f63a4-0c53-4bb0-9a67-2a1f6f9d7f0e")
_VERBS = "http://adlnet.gov/expapi/verbs/"
_SIMULATION = "http://adlnet.gov/expapi/activities/simulation"
_VERB_OF = {"success": "passed", "failure": "failed"}
#: Statements in one request, and pauses before what failed is tried again, s: each about four times as long as the one
#: before, as a busy store is only held up by more questions.
BATCH, PAUSES_S = 50, (1.0, 5.0, 20.0)
_PATIENCE_S = 30.0  # longer than a store takes for a request, so that nothing is sent twice
_REFUSALS, _ELSEWHERE = range(400, 500), range(300, 400)
#: Answers by which a store says that it is busy, and those that are of one statement among others: it is malformed, is
#: there already, or makes the batch too long.
_BUSY, _OF_ONE = (408, 429), (400, 409, 413)
#: Bytes read of an answer: 32 times what the identifiers of a batch take, 2 kB.
_LONGEST = 1 << 16


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
        if found.score.percent is not None:
            result["score"]["scaled"] = min(1.0, found.score.percent / 100.0)
    ended = datetime.fromtimestamp(found.began_ns * 1e-9 + found.time_s, UTC)
    said = {
        "timestamp": ended.isoformat(timespec="milliseconds"),
        "actor": {"objectType": "Agent", "account": {"homePage": home, "name": trainee}},
        "verb": {"id": f"{_VERBS}{verb}", "display": {"en": verb}},
        "object": {
            "objectType": "Activity",
            "id": f"{home}/trocar/scenarios/{quote(found.scenario or 'practice')}",
            "definition": {"type": _SIMULATION, "name": {"en": found.title or found.scenario or "practice"}},
        },
        "result": result,
        "context": {"platform": f"Trocar {found.version}"},
    }
    whole = msgspec.json.encode([said, found], order="deterministic")
    return {"id": str(uuid.uuid5(_NAMESPACE, whole.decode())), **said}


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
        """Send all of them; one that the store refuses keeps no other back.

        Raises UserError that says how many arrived, if the store refuses some or cannot be reached; it is safe to send
        all again.
        """
        refused: list[str] = []
        for begin in range(0, len(statements), BATCH):
            try:
                refused += self._send_batch(statements[begin : begin + BATCH])
            except UserError as error:
                raise self._told(f"{error}", begin - len(refused), len(statements)) from None
        if refused:
            why = f"refuses {len(refused)} of them, the first: {refused[0]}"
            raise self._told(why, len(statements) - len(refused), len(statements))

    def _told(self, why: str, arrived: int, count: int) -> UserError:
        return UserError(f"{self._address}: {why}; {arrived} of {count} attempts arrived, send them again")

    def _send_batch(self, batch: Sequence[dict[str, Any]]) -> list[str]:
        """Return why the store refuses statements for what they are, each of them.

        Raises UserError if it takes none from here, or is not reached.
        """
        data = msgspec.json.encode(batch)
        for pause_s in (*PAUSES_S, None):
            try:
                fault = self._try_to_post(data, [each["id"] for each in batch])
            except _StatementError as error:
                # A store may take none of a batch for the sake of one. Alone, one that it has has arrived.
                if len(batch) > 1:
                    return [why for each in batch for why in self._send_batch([each])]
                return [] if error.code == HTTPStatus.CONFLICT else [str(error)]
            if not fault:
                return []
            if pause_s is not None:
                self._pause(pause_s)
        raise UserError(fault)

    def _try_to_post(self, data: bytes, identifiers: list[str]) -> str:
        """Return why it has to be tried again, empty if the data arrived.

        Raises UserError if the store refuses it, _StatementError if because of a statement.
        """
        try:
            code, said = self._post(data)
        except (OSError, http.client.HTTPException, ValueError) as error:
            return f"cannot be reached: {getattr(error, 'reason', None) or error or type(error).__name__}"
        answer = f"{code} {_reason(code)}".strip()
        if code in _ELSEWHERE:
            raise UserError(f"leads elsewhere ({answer}{f', {said.decode()}' if said else ''}): name that address")
        if code in _OF_ONE:
            raise _StatementError(code, f"{answer}{_shown(said)}")
        if code in _REFUSALS and code not in _BUSY:
            raise UserError(f"refuses them: {answer}{_shown(said)}")
        if code == HTTPStatus.NO_CONTENT or (code == HTTPStatus.OK and _identifiers(said) >= set(identifiers)):
            return ""
        is_well = code in range(200, 300)
        return f"answers {answer}{' without the identifiers of what it was sent' if is_well else ''}"

    def _post(self, data: bytes) -> tuple[int, bytes]:
        """Return the code and text of an answer, of one that leads elsewhere the address."""
        request = urllib.request.Request(self._address, data, self._headers, method="POST")
        try:
            with open_url(request, _PATIENCE_S) as answer:
                return answer.status, answer.read(_LONGEST)
        except urllib.error.HTTPError as error:
            with error:
                if error.code in _ELSEWHERE:
                    return error.code, error.headers.get("Location", "").encode()
                return error.code, error.read(_LONGEST)


def check_endpoint(address: str) -> None:
    """Refuse an address that is none, or that holds a login, which sentences and logs would show.

    Raises ConfigError that does not show a login.
    """
    try:
        parts = urlsplit(address)
        is_one = bool(parts.hostname and parts.hostname.encode("idna")) and parts.port != 0
    except ValueError:
        is_one = False
    if not is_one:
        raise ConfigError(f"--to {address.rpartition('@')[2]}: is no address of a record store")
    if "@" in parts.netloc:
        raise ConfigError(f"--to {parts.hostname}: the address holds a login: give it as --login")


def _identifiers(said: bytes) -> set[str]:
    """Return the identifiers in an answer, none where it is another answer."""
    try:
        return {each.lower() for each in msgspec.json.decode(said, type=list[str])}
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return set()


def _shown(said: bytes) -> str:
    """Return the begin of an answer as a part of a sentence."""
    text = " ".join(said[:300].decode("utf-8", "replace").split())
    return f", {text}" if text else ""


def _reason(code: int) -> str:
    return http.client.responses.get(code, "")


class _StatementError(Exception):
    """The store does not take a statement, for what it is."""

    def __init__(self, code: int, why: str) -> None:
        super().__init__(why)
        self.code = code
