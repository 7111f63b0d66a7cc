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


class RecordStore:
    """A learning record store: `fail` says by how often it was asked what it answers instead, none to take it."""

    def __init__(self, fail: Callable[[int], int | None]) -> None:
        self.kept: dict[str, dict[str, Any]] = {}
        self.headers: list[Any] = []
        self.asked = 0
        self.fail = fail

    def answer(self, statements: list[dict[str, Any]]) -> int:
        self.asked += 1
        failure = self.fail(self.asked)
        if failure is not None:
            return failure
        if any(each["id"] in self.kept for each in statements):
            return 409  # and takes none of them, as the standard allows
        self.kept |= {each["id"]: each for each in statements}
        return 200


@contextmanager
def served(store: RecordStore) -> Iterator[str]:
    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            store.headers.append(self.headers)
            body = self.rfile.read(int(self.headers["Content-Length"]))
            self.send_response(store.answer(json.loads(body)))
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
