"""Attempts as xAPI statements: what they say, and that none is lost on the way to a store that fails now and then."""

from __future__ import annotations

import base64
import json
import re
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import msgspec
import pytest

from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.statements import BATCH, Endpoint, statement
from trocar.review.attempts.store.attempts import Store
from trocar.review.commands.attempts import run_xapi
from trocar.services.runtime.errors import ConfigError, UserError

HOME = "https://hospital.example"


@pytest.fixture
def database(attempt: Assessment, tmp_path: Path) -> str:
    """Return a database with 120 attempts of two trainees."""
    file = str(tmp_path / "a.sqlite")
    with Store(file) as store:
        for number in range(120):
            later = {"began_ns": attempt.began_ns + number * 10**9, "attempt_id": str(number)}
            trainee = ("heron-17", "magpie-2")[number % 2]
            store.add(msgspec.structs.replace(attempt, **later), trainee, tmp_path / "a.mcap")
    return file


Failure = int | tuple[int, bytes, dict[str, str]]
"""What a store answers instead: a code, or with what it says, and headers."""


class RecordStore:
    """A learning record store: `fail` says by how often it was asked what it answers instead, none to take it.

    Of a statement in `malformed` it takes no batch; with `cut_off`, the connection ends in the middle of the answer to
    what it has taken, so many times.
    """

    def __init__(self, fail: Callable[[int], Failure | None] = lambda _: None) -> None:
        self.kept: dict[str, dict[str, Any]] = {}
        self.malformed = set[str]()
        self.cut_off = 0
        self.headers: list[Any] = []
        self.asked = 0
        self.fail = fail

    def answer(self, statements: list[dict[str, Any]]) -> tuple[int, bytes, dict[str, str]]:
        self.asked += 1
        failure = self.fail(self.asked)
        if failure is not None:
            return failure if isinstance(failure, tuple) else (failure, b"", {})
        if any(each["id"] in self.malformed for each in statements):
            return 400, b"a statement is malformed", {}
        if any(each["id"] in self.kept for each in statements):
            return 409, b"", {}  # and takes none of them, as the standard allows
        self.kept |= {each["id"]: each for each in statements}
        return 200, json.dumps([each["id"] for each in statements]).encode(), {}


@contextmanager
def served(store: RecordStore) -> Iterator[str]:
    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            store.headers.append(self.headers)
            body = self.rfile.read(int(self.headers["Content-Length"]))
            code, said, headers = store.answer(json.loads(body))
            self.send_response(code)
            for header in ({"Content-Length": str(len(said))} | headers).items():
                self.send_header(*header)
            self.end_headers()
            if code == 200 and store.cut_off:
                store.cut_off -= 1
                said = said[: len(said) // 2]
            self.wfile.write(said)

        def do_GET(self) -> None:
            self.send_response(200)  # a page, as of a login
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    server = HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/xapi/statements"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def test_it_says_who_did_what_and_how_well(attempt: Assessment) -> None:
    said = statement(attempt, "heron-17", HOME)
    assert said["actor"]["account"] == {"homePage": HOME, "name": "heron-17"}
    assert said["verb"]["id"] == "http://adlnet.gov/expapi/verbs/passed"
    assert (said["result"]["success"], said["result"]["completion"]) == (True, True)
    assert attempt.score is not None
    assert said["result"]["score"]["raw"] == attempt.score.total
    assert re.fullmatch(r"PT\d+\.\d{3}S", said["result"]["duration"])
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}\+00:00", said["timestamp"])
    uuid.UUID(said["id"])


def test_an_attempt_is_always_the_same_statement_and_a_new_judgement_another(attempt: Assessment) -> None:
    judged_again = msgspec.structs.replace(attempt, outcome="failure", score=None)
    first, again, other = (statement(each, "a", HOME) for each in (attempt, attempt, judged_again))
    assert first == again
    assert other["id"] != first["id"]
    assert other["verb"]["display"]["en"] == "failed"
    assert "score" not in other["result"]


def test_to_a_file_each_is_a_line(database: str, tmp_path: Path) -> None:
    run_xapi(database, "heron-17", str(tmp_path / "out.jsonl"), f"{HOME}/", "")
    lines = [json.loads(line) for line in (tmp_path / "out.jsonl").read_text().splitlines()]
    assert len({line["id"] for line in lines}) == 60
    assert {line["actor"]["account"]["name"] for line in lines} == {"heron-17"}
    assert lines[0]["object"]["id"].startswith(f"{HOME}/trocar/scenarios/")


def test_a_store_that_fails_now_and_then_gets_all_and_each_once(database: str, monkeypatch: pytest.MonkeyPatch) -> None:
    store, waited = RecordStore(lambda asked: 503 if asked % 2 else None), list[float]()
    with Store(database, create=False) as attempts:
        statements = [statement(found, who, HOME) for who, found in attempts.kept()]
    with served(store) as address:
        for _ in range(2):  # the second time it has them all
            Endpoint(address, "me:secret", waited.append).send(statements)
    assert store.kept == {each["id"]: each for each in statements}
    assert len(store.kept) == 120 > BATCH
    assert set(waited) == {1.0}
    assert store.headers[0]["Authorization"] == f"Basic {base64.b64encode(b'me:secret').decode()}"
    assert store.headers[0]["X-Experience-API-Version"] == "1.0.3"


def test_a_new_one_among_those_that_the_store_has_arrives(database: str) -> None:
    store = RecordStore(lambda _: None)
    with Store(database, create=False) as attempts:
        statements = [statement(found, who, HOME) for who, found in attempts.kept()]
    with served(store) as address:
        Endpoint(address).send(statements[:30])
        Endpoint(address).send(statements)
    assert store.kept.keys() == {each["id"] for each in statements}


@pytest.mark.parametrize("change", [{"home": "https://clinic.example"}, {"trainee": "magpie-2"}])
def test_what_says_anything_else_is_another_statement(attempt: Assessment, change: dict[str, str]) -> None:
    usual = {"trainee": "heron-17", "home": HOME}
    assert statement(attempt, **usual)["id"] != statement(attempt, **usual | change)["id"]


def statements_of(database: str) -> list[dict[str, Any]]:
    with Store(database, create=False) as attempts:
        return [statement(found, who, HOME) for who, found in attempts.kept()]


def test_one_that_the_store_refuses_keeps_no_other_back(database: str) -> None:
    store, statements = RecordStore(), statements_of(database)
    store.malformed = {statements[3]["id"], statements[60]["id"]}
    why = "refuses 2 of them, the first: 400 Bad Request, a statement is malformed; 118 of 120 attempts arrived"
    with served(store) as address, pytest.raises(UserError, match=why):
        Endpoint(address).send(statements)
    assert store.kept.keys() == {each["id"] for each in statements} - store.malformed


def test_a_connection_that_is_lost_midway_loses_and_doubles_nothing(database: str) -> None:
    store, statements, waited = RecordStore(), statements_of(database), list[float]()
    store.cut_off = 2
    with served(store) as address:
        Endpoint(address, pause=waited.append).send(statements)
    assert store.kept.keys() == {each["id"] for each in statements}
    assert waited == [1.0, 1.0]


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        ((301, b"", {"Location": "/login"}), r"leads elsewhere \(301 Moved Permanently, /login\): name that address"),
        ((302, b"", {"Location": "https://lrs.example/x"}), r"leads elsewhere \(302 Found, https://lrs.example/x\)"),
        ((307, b"", {"Location": "/y"}), r"leads elsewhere \(307 Temporary Redirect, /y\)"),
        ((200, b"<html>Please log in</html>", {}), "answers 200 OK without the identifiers of what it was sent"),
        ((200, b"", {}), "answers 200 OK without the identifiers of what it was sent"),
        ((200, b'["5f6c7fb0-0000-0000-0000-000000000000"]', {}), "without the identifiers of what it was sent"),
        ((202, b"", {}), "answers 202 Accepted without the identifiers"),
        ((500, b"oh", {"Content-Length": "99"}), "answers 500 Internal Server Error"),
        ((403, b"no\nno", {}), "refuses them: 403 Forbidden, no no"),
        ((599, b"", {}), "answers 599"),
    ],
)
def test_nothing_has_arrived_of_which_the_store_does_not_say_so(
    database: str, answer: Failure, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("trocar.review.attempts.statements.PAUSES_S", (0.0,))
    store = RecordStore(lambda _: answer)
    with served(store) as address:
        with pytest.raises(UserError, match=f"{why}.*; 0 of 120 attempts arrived, send them again") as caught:
            run_xapi(database, None, address, HOME, "")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("to", "home", "said"),
    [
        ("http://", HOME, "--to http://: is no address of a record store"),
        ("http://a..b/x", HOME, "is no address of a record store"),
        ("https://lrs.example:port/x", HOME, "is no address of a record store"),
        ("https://me:secret@lrs.example/x", HOME, "--to lrs.example: the address holds a login: give it as --login"),
        ("https://lrs.example/x", "hospital", "--home hospital: is no http or https address"),
    ],
)
def test_an_address_that_is_none_is_a_sentence(database: str, to: str, home: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        run_xapi(database, None, to, home, "")
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize(
    ("answer", "why"), [(500, "answers 500 Internal Server Error"), (401, "refuses them: 401 Unauthorized")]
)
def test_what_did_not_arrive_is_told_and_can_be_sent_again(
    database: str, answer: int, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("trocar.review.attempts.statements.PAUSES_S", (0.0, 0.0))
    store = RecordStore(lambda asked: answer if asked > 1 else None)
    with served(store) as address:
        with pytest.raises(UserError, match=f"{why}.*; 50 of 120 attempts arrived, send them again"):
            run_xapi(database, None, address, HOME, "")
        store.fail = lambda _: None
        run_xapi(database, None, address, HOME, "")
    assert len(store.kept) == 120


def test_nobody_there_and_no_address_are_sentences(database: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trocar.review.attempts.statements.PAUSES_S", ())
    with pytest.raises(UserError, match=r"127\.0\.0\.1:9/x: cannot be reached: .*; 0 of 120 attempts arrived"):
        run_xapi(database, None, "http://127.0.0.1:9/x", HOME, "")
    with pytest.raises(ConfigError, match="--to ftp://a: is neither a file nor an http or https address"):
        run_xapi(database, None, "ftp://a", HOME, "")
