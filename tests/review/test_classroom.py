"""Ten rigs' pages on one page: what it shows, whom it answers, and that no rig can hold up or fill the class."""

from __future__ import annotations

import functools
import socket
import threading
import time
from collections.abc import Iterator
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

from tests.by_day import by_day
from tests.chromium import Chromium, find
from tests.patience import PATIENCE_S
from tests.review.benches import made_up
from tests.review.class_of_pages import TOKEN, rigs, served, state, until, write_roll
from trocar.protocol import bodies
from trocar.review.attempts.store.attempts import Store
from trocar.review.classroom import watch
from trocar.review.classroom.app import Classroom, build_app
from trocar.review.classroom.roll import ClassRig
from trocar.review.classroom.watch import Watch
from trocar.services.runtime.errors import UserError
from trocar.services.runtime.web import web_certificate
from trocar.services.runtime.web.web_certificate import own_names
from trocar.services.supervisor.control.commands import Command
from trocar.services.supervisor.page.web import PageContext
from trocar.services.training.score import Score

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
            told = {
                "state": "running", "outcome": "", "title": "Insert", "phase": "P3", "time_s": 12.5, "depth_m": 0.02,
                "goal_depth_m": 0.04, "errors": {"E1": 2},
            }  # fmt: skip
            assert {key: first["attempt"][key] for key in told} == told
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


def test_the_last_score_of_who_sits_there_is_shown(tmp_path: Path) -> None:
    database = tmp_path / "attempts.sqlite"
    with Store(str(database)) as store:
        for name, who, total in (("1", "heron-17", 50.0), ("2", "heron-17", 71.0), ("3", "wren-2", 12.0)):
            score = Score(total=total, time_saved_s=total, penalties_s=0.0, percent=None)
            found = msgspec.structs.replace(made_up(name), began_ns=int(name), score=score)
            store.add(found, who, tmp_path / "a.mcap")
    file = write_roll(tmp_path / "class.toml", ["http://127.0.0.1:1"] * 2, more=f'database = "{database}"',
                      bench_0="heron-17", bench_1="magpie-2")  # fmt: skip
    with _shown(file) as (_, address):
        until(lambda: _rows(address)["bench-0"]["score"] == 71.0, "the last score")
        assert _rows(address)["bench-1"]["score"] is None


def test_scores_come_from_the_database_and_one_that_cannot_be_had_is_told(tmp_path: Path) -> None:
    file = write_roll(tmp_path / "class.toml", ["http://127.0.0.1:1"], more='database = "nonsense+driver://x/y"',
                      bench_0="heron-17")  # fmt: skip
    with _shown(file) as (classroom, _):
        until(lambda: "address of the database cannot be read" in classroom.remark, "it is told")
        place = tmp_path / "attempts.sqlite"
        write_roll(file, ["http://127.0.0.1:1"], more=f'database = "{place}"', bench_0="heron-17")
        classroom.look()
        until(lambda: f"there is no database of attempts at {place}" in classroom.remark, "nobody was judged yet")
        with Store(str(place)):
            pass
        write_roll(file, ["http://127.0.0.1:1"] * 2, more=f'database = "{place}"', bench_0="heron-17")
        classroom.look()
        until(lambda: classroom.remark == "", "the database is there")


@pytest.mark.parametrize("turn", by_day([0, 1], range(2, 20)))
@pytest.mark.parametrize("is_new", [True, False])
def test_ten_rigs_with_a_database_that_start_together_are_all_heard(
    tmp_path: Path, turn: int, is_new: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their threads brought the tables up to date at once, and died of it; a live rig was silent for ever."""
    died: list[object] = []
    monkeypatch.setattr(threading, "excepthook", died.append)
    database = tmp_path / f"{turn}.sqlite"
    database.touch()  # no tables yet: whoever comes first makes them
    if not is_new:
        with Store(str(database)):
            pass
    names = {f"bench_{k}": f"heron-{k}" for k in range(10)}
    with rigs(10) as (_, addresses):
        file = write_roll(tmp_path / "class.toml", addresses, more=f'database = "{database}"', **names)
        with _shown(file) as (classroom, address):
            until(lambda: all(row["state"] != "silent" for row in _rows(address).values()), "all ten are heard")
            for _ in range(5):
                assert [row["state"] for row in _rows(address).values()] == ["running"] * 10
                with Store(str(database)) as store:
                    store.listed()
                time.sleep(0.05)
            assert (classroom.remark, died) == ("", [])


def test_a_database_that_does_not_answer_silences_no_rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its server takes the call and says nothing; each rig's own thread waited for it."""
    monkeypatch.setattr(watch, "SILENT_S", 2.0)
    with socket.create_server(("127.0.0.1", 0)) as mute, rigs(2) as (contexts, addresses):
        url = f"postgresql+psycopg://me@127.0.0.1:{mute.getsockname()[1]}/x"
        names = {"bench_0": "heron-17", "bench_1": "wren-2"}
        file = write_roll(tmp_path / "class.toml", addresses, more=f'database = "{url}"', **names)
        with _shown(file) as (_, address):
            mute.settimeout(PATIENCE_S)
            with mute.accept()[0]:
                time.sleep(3.0)
                for context in contexts:
                    context.latest = state(state="degraded")
                until(lambda: {row["state"] for row in _rows(address).values()} == {"degraded"}, "both followed", 5.0)


def test_a_rig_whose_thread_has_died_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("a fault of ours")

    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    monkeypatch.setattr(watch, "open_connection", fail)
    made = Watch(ClassRig(name="a", address="http://127.0.0.1:1"), lambda _: None)
    until(lambda: "a fault of this program" in made.row().fault, "it is said")
    assert made.row().state == "silent"


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
def test_an_encrypted_rig_is_known_by_its_fingerprint_and_shown_with_its_picture(tmp_path: Path) -> None:
    """Whoever answers in its place with a certificate of his own is not believed."""
    genuine, forged = (web_certificate.make(tmp_path / name, own_names()) for name in ("genuine", "forged"))
    view = Starlette(routes=[Route("/snapshot.png", lambda _: Response(b"\x89PNG of the rig"))])
    with served(view, certificate=genuine) as [seen]:
        told = msgspec.json.encode({"view_ws": f"wss://127.0.0.1:{httpx.URL(seen).port}/ws", "state": "running"})
        for certificate, said in ((genuine, ""), (forged, "fingerprint")):
            with served(_app(told), certificate=certificate) as [address]:
                made = Watch(ClassRig(name="a", address=address, fingerprint=genuine.fingerprint), lambda _: None)
                try:
                    until(functools.partial(_is_known, made, said), "it is heard, or refused")
                    if not said:
                        assert made.picture() == b"\x89PNG of the rig"
                finally:
                    made.close()


def _is_known(watch: Watch, said: str) -> bool:
    row = watch.row()
    return said in row.fault if said else row.state == "running"


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


_POLICY_OF_NOTHING = "default-src 'none'"


@pytest.mark.parametrize("path", ["/", "/api/class", "/api/picture/bench-0", "/nowhere"])
def test_every_answer_says_that_nothing_else_runs_in_it_and_nobody_frames_it(tmp_path: Path, path: str) -> None:
    with _shown(write_roll(tmp_path / "class.toml", ["http://127.0.0.1:1"])) as (_, address):
        for headers in ({}, _WITH, {"Host": "evil.example"}):
            said = _get(f"{address}{path}", headers=headers).headers
            policy = said["Content-Security-Policy"]
            assert policy.startswith(_POLICY_OF_NOTHING)
            assert "frame-ancestors 'none'" in policy
            assert "unsafe" not in policy
            assert said["X-Content-Type-Options"] == "nosniff"
            assert said["Cache-Control"] == "no-store"


@pytest.mark.parametrize(
    ("announced", "why"),
    [
        ("ws://127.0.0.1:{port}/ws", ""),
        ("ws://localhost:{port}/ws", "at another machine: localhost"),
        ("ws://10.0.0.7:{port}/ws", "at another machine: 10.0.0.7"),
        ("http://127.0.0.1:{port}/ws", "announces none"),
        ("file:///etc/passwd", "announces none"),
        ("ws://127.0.0.1/ws", "announces none"),
        ("ws://127.0.0.1:0/ws", "announces none"),
        ("ws://127.0.0.1:99999/ws", "Port out of range"),
        ("ws://127.0.0.1:{other}/ws", "sends no PNG"),
        ("", "announces none"),
    ],
)
def test_a_picture_comes_from_the_port_that_the_rig_announces_and_nowhere_else(announced: str, why: str) -> None:
    asked: list[str] = []

    def draw(request: Request) -> Response:
        asked.append(str(request.url))
        return Response(b"\x89PNG of the rig", media_type="image/png")

    view, secret = Starlette(routes=[Route("/snapshot.png", draw)]), _app(b"a secret of another server")
    with served(view, secret) as [here, other]:
        ports = {"port": httpx.URL(here).port, "other": httpx.URL(other).port}
        told = msgspec.json.encode({"view_ws": announced.format(**ports)})
        with served(_app(told)) as [rig]:
            made = Watch(ClassRig(name="a", address=rig), lambda _: None)
            try:
                if why:
                    with pytest.raises(UserError, match=why):
                        made.picture()
                else:
                    assert made.picture() == b"\x89PNG of the rig"
            finally:
                made.close()
    assert len(asked) == (0 if why else 1)


def _acting(context: PageContext, asked: list[Command], seconds: float = 0.0) -> None:
    """Let a rig take commands of the class, and answer each after so long."""

    def ask(command: Command) -> bodies.Answer:
        time.sleep(seconds)
        asked.append(command)
        return bodies.Answer(order=0, ok=True, text="done here")

    context.ask, context.class_token = ask, TOKEN


def test_an_instructor_commands_one_bench_or_all_from_the_desk(tmp_path: Path) -> None:
    with rigs(10) as (contexts, addresses):
        asked: list[list[Command]] = [[] for _ in contexts]
        for context, commands in zip(contexts, asked, strict=True):
            context.latest = state(incarnation=7, t=1.0)
            _acting(context, commands)
        file = write_roll(tmp_path / "class.toml", addresses)
        with _shown(file) as (_, address):
            until(lambda: all(row["state"] != "silent" for row in _rows(address).values()), "all ten answer")
            one = {"what": "order", "word": "pause", "rigs": ["bench-3"], "by": "dr-b"}
            assert httpx.post(f"{address}/api/act", json=one).status_code == 403
            said = httpx.post(f"{address}/api/act", json=one, headers=_WITH, timeout=PATIENCE_S).json()["outcomes"]
            assert said == [{"rig": "bench-3", "ok": True, "text": "done here"}]
            assert [len(each) for each in asked] == [0, 0, 0, 1, 0, 0, 0, 0, 0, 0]
            (order,) = asked[3]
            assert (order.what, order.order.what if order.order else "", order.incarnation) == ("attempt", "pause", 7)
            every = {"what": "order", "word": "new"}
            said = httpx.post(f"{address}/api/act", json=every, headers=_WITH, timeout=PATIENCE_S).json()["outcomes"]
            assert [each["ok"] for each in said] == [True] * 10
            assert min(map(len, asked)) == 1
            acts = _get(f"{address}/api/journal", headers=_WITH).json()
            assert [(each["by"], each["word"], len(each["outcomes"])) for each in acts] == [
                ("instructor", "new", 10), ("dr-b", "pause", 1),
            ]  # fmt: skip


def test_a_bench_that_has_another_token_or_is_gone_holds_up_no_other(tmp_path: Path) -> None:
    with rigs(3) as (contexts, addresses):
        asked: list[Command] = []
        for context in contexts:
            context.latest = state(incarnation=7, t=1.0)
        _acting(contexts[0], asked)
        file = write_roll(tmp_path / "class.toml", [*addresses, "http://127.0.0.1:9"])
        with _shown(file) as (_, address):
            until(lambda: len([r for r in _rows(address).values() if r["state"] != "silent"]) == 3, "three answer")
            act = {"what": "order", "word": "new"}
            said = httpx.post(f"{address}/api/act", json=act, headers=_WITH, timeout=PATIENCE_S).json()["outcomes"]
            assert [each["ok"] for each in said] == [True, False, False, False]
            assert "token" in said[1]["text"]
            assert said[3]["text"].startswith("does not answer")
            assert len(asked) == 1


def test_the_class_table_needs_a_database_and_the_token(tmp_path: Path) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store:
        store.add(made_up("a"), "heron-17", tmp_path / "a.mcap")
    with rigs(1) as (_, addresses):
        with _shown(write_roll(tmp_path / "without.toml", addresses)) as (_, address):
            assert _get(f"{address}/school/class", headers=_WITH).status_code == 409
        more = f'database = "{tmp_path / "a.sqlite"}"'
        with _shown(write_roll(tmp_path / "with.toml", addresses, more=more)) as (_, address):
            assert _get(f"{address}/school/class").status_code == 403
            assert [each["trainee"] for each in _get(f"{address}/school/class", headers=_WITH).json()] == ["heron-17"]
            assert "heron-17" in _get(f"{address}/school/export/csv", headers=_WITH).text
