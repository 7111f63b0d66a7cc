"""Ten rigs' pages on one page: what it shows, whom it answers, and that no rig can hold up or fill the class."""

from __future__ import annotations

import functools
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from tests.chromium import Chromium, find
from tests.patience import PATIENCE_S
from tests.review.class_of_pages import TOKEN, rigs, served, state, until, write_roll
from trocar.review.classroom import app, watch
from trocar.review.classroom.app import Classroom, build_app
from trocar.review.classroom.roll import ClassRig
from trocar.review.classroom.watch import Watch

_WITH = {"X-Trocar-Token": TOKEN}
#: httpx gives up after five seconds: a busy machine may take them.
_get = functools.partial(httpx.get, timeout=PATIENCE_S)


@contextmanager
def _shown(file: Path) -> Iterator[tuple[Classroom, str]]:
    classroom = Classroom(file)
    try:
        with served(build_app(classroom)) as [address]:
            yield classroom, address
    finally:
        classroom.close()


def _rows(address: str) -> dict[str, dict[str, Any]]:
    told = _get(f"{address}/api/class", headers=_WITH).json()
    return {row["name"]: row for row in told["rigs"]}


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watch, "PERIOD_S", 0.1)


def test_ten_rigs_are_shown_each_as_it_stands(tmp_path: Path) -> None:
    with rigs(10) as (contexts, addresses):
        contexts[1].latest = state(state="safe_stop", reason="commanded", attempt=None)
        contexts[2].latest = state(processes=[{"name": "physics", "loop": {"contract_ok": False}}],
                                   paths=[{"name": "servo", "ok": False}])  # fmt: skip
        file = write_roll(tmp_path / "class.toml", addresses, bench_0="heron-17")
        with _shown(file) as (_, address):
            until(lambda: all(row["state"] != "silent" for row in _rows(address).values()), "all ten answer")
            rows = _rows(address)
            assert list(rows) == [f"bench-{k}" for k in range(10)]
            first = rows["bench-0"]
            assert (first["state"], first["trainee"], first["late"]) == ("running", "heron-17", [])
            assert first["attempt"] == {
                "state": "running", "outcome": "", "title": "Insert", "phase": "P3", "time_s": 12.5, "depth_m": 0.02,
                "goal_depth_m": 0.04, "errors": {"E1": 2},
            }  # fmt: skip
            assert (rows["bench-1"]["state"], rows["bench-1"]["attempt"]) == ("safe_stop", None)
            assert rows["bench-2"]["late"] == ["physics", "servo"]
            contexts[0].latest = state(state="degraded")
            until(lambda: _rows(address)["bench-0"]["state"] == "degraded", "the change is shown")


@pytest.mark.parametrize("path", ["/api/class", "/api/picture/bench-0"])
@pytest.mark.parametrize("headers", [{}, {"X-Trocar-Token": "guess"}, {"X-Trocar-Token": ""}])
def test_without_the_token_of_the_class_nothing_is_told(tmp_path: Path, path: str, headers: dict[str, str]) -> None:
    with _shown(write_roll(tmp_path / "class.toml", ["http://127.0.0.1:1"], bench_0="heron-17")) as (_, address):
        answer = _get(f"{address}{path}", headers=headers)
        assert answer.status_code == 403
        assert "heron" not in answer.text
        page = _get(address)
        assert page.status_code == 200
        assert "heron" not in page.text
        assert TOKEN not in page.text
        assert _get(address, headers={"Host": "evil.example"}).status_code == 421


def test_a_rig_that_ends_is_silent_and_is_shown_again_when_it_is_back(tmp_path: Path) -> None:
    with rigs(1) as (_, [other]):
        with rigs(1) as (_, [address_of_rig]):
            file = write_roll(tmp_path / "class.toml", [address_of_rig, other])
            with _shown(file) as (_, address):
                until(lambda: _rows(address)["bench-0"]["state"] == "running", "it answers")
        with _shown(file) as (_, address):
            until(lambda: "refused" in _rows(address)["bench-0"]["fault"], "it is gone")
            until(lambda: _rows(address)["bench-1"]["state"] == "running", "the other one is there")
            assert _rows(address)["bench-0"]["state"] == "silent"


def test_the_file_may_change_while_the_class_is_on(tmp_path: Path) -> None:
    with rigs(2) as (_, addresses):
        file = write_roll(tmp_path / "class.toml", addresses)
        with _shown(file) as (classroom, address):
            kept = classroom.watch("bench-1")
            write_roll(file, addresses, bench_0="magpie-2")
            until(lambda: _rows(address)["bench-0"]["trainee"] == "magpie-2", "the new trainee")
            assert classroom.watch("bench-1") is kept
            file.write_text("token = ")
            until(lambda: "Invalid value" in _get(f"{address}/api/class", headers=_WITH).json()["remark"], "said")
            assert len(_rows(address)) == 2


def _app(answer: bytes, status: int = 200) -> Starlette:
    async def told(_request: Request) -> Response:
        return Response(answer, status, media_type="application/json")

    return Starlette(routes=[Route("/{any:path}", told)])


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (b"[1, 2]", "Expected `object`"),
        (b"{" * 1000, "JSON is malformed"),
        (b'{"state": 7}', "Expected `str`"),
        (b'{"attempt": {"depth_m": "deep"}}', "Expected `float"),
        (b" " * ((1 << 20) + 9), "more than 1048576 bytes"),
        (b"\xff\xfe", "malformed"),
    ],
)
def test_a_rig_that_is_mad_is_a_sentence_and_no_other_rig_suffers(tmp_path: Path, answer: bytes, why: str) -> None:
    file = tmp_path / "class.toml"
    with rigs(1) as (_, [sound]), served(_app(answer)) as [mad], _shown(write_roll(file, [mad, sound])) as (_, address):
        until(lambda: why in _rows(address)["bench-0"]["fault"], f"{why}: {_rows(address)['bench-0']}")
        until(lambda: _rows(address)["bench-1"]["state"] == "running", "the other one is there")


def test_a_rig_that_takes_calls_and_never_answers_holds_up_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, "_PATIENCE_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as mute, rigs(1) as (_, [sound]):
        silent = f"http://127.0.0.1:{mute.getsockname()[1]}"
        with _shown(write_roll(tmp_path / "class.toml", [silent, sound])) as (_, address):
            until(lambda: _rows(address)["bench-0"]["fault"] == "timed out", "it was given up")
            until(lambda: _rows(address)["bench-1"]["state"] == "running", "the other one is there")


def test_the_last_score_of_who_sits_there_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watch, "_SCORE_EVERY_S", 0.1)
    asked: list[str] = []
    made = Watch(
        ClassRig(name="a", address="http://127.0.0.1:1", trainee="heron-17"), lambda who: asked.append(who) or 71.0
    )
    try:
        until(lambda: made.row().score == 71.0, "a score")
        assert set(asked) == {"heron-17"}
    finally:
        made.close()


def test_scores_come_from_the_database_and_one_that_cannot_be_had_is_told(tmp_path: Path) -> None:
    bad = write_roll(tmp_path / "class.toml", ["http://127.0.0.1:1"], more='database = "nonsense+driver://x/y"')
    classroom = Classroom(bad)
    try:
        assert classroom._last_score("heron-17") is None
        assert classroom.remark
        write_roll(bad, ["http://127.0.0.1:1"], more=f'database = "{tmp_path / "attempts.sqlite"}"')
        classroom.look()
        assert classroom._last_score("heron-17") is None  # nobody has been judged yet
        assert classroom.remark == ""
    finally:
        classroom.close()


def test_a_picture_comes_on_demand_and_one_at_a_time(tmp_path: Path) -> None:
    drawn, go_on = threading.Semaphore(0), threading.Event()

    def draw(_request: Request) -> Response:
        drawn.release()
        go_on.wait(30)
        return Response(b"\x89PNG of the rig", media_type="image/png")

    with rigs(1) as ([context], [rig]), served(Starlette(routes=[Route("/snapshot.png", draw)])) as [view]:
        context.view_port = lambda: httpx.URL(view).port or 0
        with _shown(write_roll(tmp_path / "class.toml", [rig])) as (_, address):
            first: list[httpx.Response] = []
            picture = f"{address}/api/picture/bench-0"
            asking = threading.Thread(target=lambda: first.append(_get(picture, headers=_WITH)))
            asking.start()
            assert drawn.acquire(timeout=PATIENCE_S)
            assert _get(picture, headers=_WITH).status_code == 503
            go_on.set()
            asking.join()
            assert (first[0].status_code, first[0].content) == (200, b"\x89PNG of the rig")
            assert _get(f"{address}/api/picture/nobody", headers=_WITH).status_code == 404
            context.view_port = lambda: 1
            assert _get(picture, headers=_WITH).status_code == 503


@pytest.mark.skipif(find() is None, reason="no browser here")
def test_the_page_shows_the_class_and_takes_no_text_for_markup(tmp_path: Path) -> None:
    with rigs(10) as (contexts, addresses), Chromium(tmp_path / "profile") as browser:
        contexts[3].latest = state(state="safe_stop", reason="<img src=x onerror=document.title='hacked'>")
        with _shown(write_roll(tmp_path / "class.toml", addresses, bench_0="<b>heron</b>")) as (_, address):
            browser.open(f"{address}/#token={TOKEN}")
            bad = "document.querySelectorAll('article.bad').length"
            until(lambda: browser.evaluate(f"{bad} === 1 && document.querySelectorAll('article').length === 10"), "ten")
            assert browser.evaluate("document.querySelectorAll('b.state')[3].textContent") == "safe stop"
            assert "<img src=x" in browser.evaluate("document.querySelector('article.bad .reason').textContent")
            assert browser.evaluate("document.querySelectorAll('article p img, article p b').length") == 0
            assert browser.evaluate("document.title") == "Trocar: class"
            assert "<b>heron</b>" in browser.text(".trainee")
            assert browser.evaluate("document.querySelector('progress').value") == 0.5


def test_what_is_told_is_json_of_rows(tmp_path: Path) -> None:
    classroom = Classroom(write_roll(tmp_path / "class.toml", ["http://127.0.0.1:1"]))
    try:
        assert set(msgspec.json.decode(classroom.told())) == {"remark", "rigs"}
    finally:
        classroom.close()


def test_a_rig_may_ask_for_the_last_score_as_soon_as_it_is_watched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a busy machine a rig's thread ran before the class knew its file, and ended: the rig was silent for ever."""
    told: list[float | None] = []

    class Hasty(Watch):
        def __init__(self, place: ClassRig, last_score: Callable[[str], float | None]) -> None:
            told.append(last_score("heron-17"))
            super().__init__(place, last_score)

    monkeypatch.setattr(app, "Watch", Hasty)
    Classroom(write_roll(tmp_path / "class.toml", ["http://127.0.0.1:1"])).close()
    assert told == [None]
