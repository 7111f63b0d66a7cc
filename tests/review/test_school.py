"""The school at a rig: who trains, what is kept and judged, what comes next, and what only an instructor may do."""

from __future__ import annotations

import errno
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest

from tests.patience import PATIENCE_S
from tests.refusals import assert_refused
from tests.review.benches import made_up
from tests.review.class_of_pages import served
from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.store.attempts import Listed
from trocar.review.school import courses
from trocar.review.school.app import ROLE, build_app
from trocar.review.school.bench import GUEST, Bench
from trocar.review.school.courses import Course, Made, course_names, load_course, standing
from trocar.services.runtime.errors import UserError
from trocar.services.training.errors import ERRORS, ErrorEvent
from trocar.services.training.score import Score, load_rules

TRAINEE, INSTRUCTOR = {ROLE: "trainee"}, {ROLE: "instructor"}
CRUSHED = ErrorEvent(
    code="E8", evidence="squeeze of the catheter", severity="consequential", phase="P4", begin_s=4.0, end_s=5.0,
    worst=3.4, limit=3.0, unit="N",
)  # fmt: skip
_DAY_NS = 86_400 * 10**9


def attempt(name: str, **given: Any) -> Assessment:
    base: dict[str, Any] = {
        "score": Score(total=220.0, time_saved_s=240.0, penalties_s=20.0), "errors": [CRUSHED],
        "limits": {"tool_duct": 2.6}, **given,
    }  # fmt: skip
    return msgspec.structs.replace(made_up(name), **base)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(str(tmp_path / "a.sqlite"))


@pytest.fixture
def client(bench: Bench) -> Iterator[httpx.Client]:
    with served(build_app(bench)) as [address], httpx.Client(base_url=address, timeout=PATIENCE_S) as client:
        yield client


def row(k: int, *, scenario: str = "basic", day: int = 0, **given: Any) -> Made:
    values: dict[str, Any] = {
        "outcome": "success", "counts": True, "time_s": 20.0, "total": 200.0, "percent": None, "errors": 0,
        "critical": 0,
    } | given  # fmt: skip
    examined = bool(values.pop("examined", False))
    listed = Listed(id=k, trainee="heron-17", scenario=scenario, began_ns=day * _DAY_NS + k, recording="", **values)
    return Made(listed, examined)


def course(*steps: dict[str, Any]) -> Course:
    whole = [{"title": f"task {k}", "scenario": "basic", **step} for k, step in enumerate(steps)]
    return Course.model_validate({"title": "made up", "steps": tuple(whole)}, strict=False)


def states(made: list[Made], *steps: dict[str, Any]) -> list[str]:
    return [each.state for each in standing(course(*steps), made, load_rules())]


def test_the_shipped_courses_can_be_taken() -> None:
    assert {"basics", "cholangiography", "examination"} <= set(course_names())
    for name in course_names():
        assert load_course(name).steps


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("title: wrong\nsteps: [{title: a, scenario: nowhere}]", r"steps.0.scenario: .*nowhere"),
        ("title: wrong\nsteps: [{title: a, scenario: basic, pass: {}}]", r".*pass"),
        ("title: wrong", r"steps: this key is missing"),
        ("steps: [{title: a, scenario: basic}]", r"title: this key is missing"),
        ("[1]", r"the file must be a mapping"),
    ],
)
def test_a_mistake_in_a_course_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    assert_refused(lambda file: load_course(str(file)), tmp_path / "wrong.yaml", text, f"wrong.yaml: {sentence}")


def test_so_many_in_a_row_means_one_after_the_other() -> None:
    rule = {"passes": {"in_a_row": 3, "score": 180.0}}
    good, bad = {"total": 200.0}, {"total": 100.0}
    assert states([row(k, **good) for k in range(2)], rule) == ["now"]
    assert states([row(k, **each) for k, each in enumerate([good, good, bad, good])], rule) == ["now"]
    assert states([row(k, **each) for k, each in enumerate([good, bad, good, good, good])], rule) == ["passed"]
    assert states([row(k, counts=k != 1) for k in range(3)], rule) == ["now"], "what does not count is not in the row"


def test_a_task_begins_once_the_one_before_is_passed() -> None:
    steps: tuple[dict[str, Any], ...] = ({}, {"passes": {"in_a_row": 2}}, {"is_test": True})
    assert states([], *steps) == ["now", "later", "later"]
    assert states([row(0)], *steps) == ["passed", "now", "later"]
    assert states([row(0), row(1), row(2)], *steps) == ["passed", "passed", "now"]
    assert states([row(k) for k in range(3)] + [row(3, outcome="failure")], *steps) == ["passed"] * 3, "a test ends"


def test_an_examination_takes_only_attempts_without_help() -> None:
    assert states([row(0)], {"coaching": "none"}) == ["now"]
    assert states([row(0, examined=True)], {"coaching": "none"}) == ["passed"]


def test_errors_days_and_cusum_can_be_asked_for() -> None:
    assert states([row(0, errors=2)], {"passes": {"errors": 1}}) == ["now"]
    assert states([row(0, critical=1)], {}) == ["now"], "a critical error passes nothing unless it is said"
    assert states([row(0), row(1)], {"passes": {"days": 2}}) == ["now"]
    assert states([row(0), row(1, day=1)], {"passes": {"days": 2}}) == ["passed"]
    assert states([row(0)], {"passes": {"cusum": True}}) == ["now"], "one success clears nobody"
    assert states([row(k) for k in range(40)], {"passes": {"cusum": True}}) == ["passed"]


def test_each_finished_attempt_is_kept_at_once_under_who_trains(bench: Bench, tmp_path: Path) -> None:
    bench.take_assessment(attempt("a"), None)
    bench.enter("heron-17")
    bench.take_assessment(attempt("b"), None)
    bench.take_assessment(attempt("c", outcome="abandoned"), None)
    with bench.store() as store:
        assert sorted((each.trainee, each.scenario) for each in store.listed()) == [
            (GUEST, "basic"), ("heron-17", "basic"),
        ]  # fmt: skip
    silent = Bench(str(tmp_path / "b.sqlite"), keeps_guests=False)
    silent.take_assessment(attempt("d"), None)
    with silent.store() as store:
        assert store.listed() == []


def test_a_database_that_fails_is_told_and_loses_no_rig(bench: Bench, tmp_path: Path) -> None:
    broken = Bench(str(tmp_path / "no" / "such" / "\0" / "a.sqlite"))
    with pytest.raises((UserError, ValueError)):
        broken.state()
    (tmp_path / "text.sqlite").write_text("this is no database, but a text that is long enough")
    wrong = Bench(str(tmp_path / "text.sqlite"))
    wrong.take_assessment(attempt("a"), None)
    assert wrong.remark.startswith("the last attempt is not kept: ")


def test_a_pin_keeps_others_out(bench: Bench) -> None:
    bench.enter("heron-17")
    bench.mark("heron-17", "pin", "4711", "instructor")
    bench.leave()
    with pytest.raises(UserError, match="PIN"):
        bench.enter("heron-17", "0000")
    assert bench.trainee == ""
    bench.enter("heron-17", "4711")
    assert bench.trainee == "heron-17"


def test_a_report_says_what_cost_points_and_what_is_next(client: httpx.Client, bench: Bench) -> None:
    client.post("/enter", json={"trainee": "heron-17"}, headers=TRAINEE)
    state = client.post("/course", json={"course": "basics"}, headers=TRAINEE).json()
    assert (state["next"]["number"], state["next"]["of"]) == (1, len(load_course("basics").steps))
    bench.take_assessment(attempt("a", began_ns=time.monotonic_ns()), None)
    state = client.get("/state", headers=TRAINEE).json()
    report = client.get(f"/attempts/{state['last']}", headers=TRAINEE).json()
    assert [(each["code"], each["points"], each["begin_s"]) for each in report["costs"]] == [("E8", 20.0, 4.0)]
    assert report["advice"] == [ERRORS["E8"][1]]
    assert state["next"]["number"] == 2, "the test before is passed by any attempt"
    curve = client.get("/curve?trainee=heron-17&scenario=basic", headers=TRAINEE).json()
    assert (curve["score"], curve["band"], curve["band_of"]) == ([220.0], None, 0)


def test_the_band_says_how_many_stand_behind_it(client: httpx.Client, bench: Bench) -> None:
    bench.enter("wren-2")
    for k, total in enumerate((260.0, 280.0)):
        bench.take_assessment(attempt(f"e{k}", metrics={"time_s": 20.0, "total": total}, score=None), None)
    assert (
        client.post("/mark", json={"trainee": "wren-2", "kind": "expert", "value": True}, headers=TRAINEE).status_code
        == 403
    )
    client.post("/mark", json={"trainee": "wren-2", "kind": "expert", "value": True}, headers=INSTRUCTOR)
    curve = client.get("/curve?trainee=heron-17&scenario=basic", headers=TRAINEE).json()
    assert (curve["band"]["mean"], curve["band_of"]) == (270.0, 2)


def test_a_rating_is_kept_with_the_attempt_and_in_the_journal(client: httpx.Client, bench: Bench) -> None:
    bench.enter("heron-17")
    bench.take_assessment(attempt("a"), None)
    rating = {"scale": "goals", "points": {"Efficiency": 4}, "by": "dr-b"}
    assert client.post("/attempts/1/rating", json=rating, headers=TRAINEE).status_code == 403
    assert client.post("/attempts/1/rating", json=rating, headers=INSTRUCTOR).status_code == 200
    wrong = client.post("/attempts/1/rating", json={**rating, "points": {"Efficiency": 6}}, headers=INSTRUCTOR)
    assert (wrong.status_code, wrong.json()["error"]) == (409, "goals: Efficiency is not rated from 1 to 5")
    client.post("/attempts/1/bookmark", json={"at_s": 4.5, "words": "look here"}, headers=INSTRUCTOR)
    notes = client.get("/attempts/1", headers=TRAINEE).json()["notes"]
    assert [(each["kind"], each["data"]) for each in notes] == [
        ("goals", {"Efficiency": 4}), ("bookmark", {"at_s": 4.5, "words": "look here"}),
    ]  # fmt: skip
    acts = client.get("/journal", headers=INSTRUCTOR).json()
    assert [each["act"] for each in acts] == ["bookmark", "rate"]


def test_a_replay_is_kept_once_and_goes_with_its_trainee(client: httpx.Client, bench: Bench) -> None:
    bench.enter("heron-17")
    bench.take_assessment(attempt("20261130T1-a"), None)
    assert client.get("/replay/20261130T1-a", headers=TRAINEE).status_code == 404
    client.put("/replay/20261130T1-a", content=b"pictures", headers=TRAINEE)
    client.put("/replay/20261130T1-a", content=b"others", headers=TRAINEE)
    assert client.get("/replay/20261130T1-a", headers=TRAINEE).content == b"pictures"
    assert client.put("/replay/..%2Fescape", content=b"x", headers=TRAINEE).status_code in (400, 404)
    assert client.get("/attempts?trainee=heron-17", headers=TRAINEE).json()[0]["has_replay"]
    assert client.get("/ghost/basic", headers=TRAINEE).json() == {"attempt_id": "20261130T1-a"}
    client.post("/erase", json={"trainee": "heron-17"}, headers=INSTRUCTOR)
    assert client.get("/replay/20261130T1-a", headers=TRAINEE).status_code == 404
    assert client.get("/class", headers=INSTRUCTOR).json() == []
    assert b"heron" not in bench.journal.path.read_bytes(), "the journal tells that somebody was erased, not who"


def test_the_class_is_exported_by_an_instructor_alone(client: httpx.Client, bench: Bench) -> None:
    bench.enter("heron-17")
    bench.take_assessment(attempt("a"), None)
    for form in ("csv", "json", "xapi"):
        assert client.get(f"/export/{form}", headers=TRAINEE).status_code == 403
        assert "heron-17" in client.get(f"/export/{form}", headers=INSTRUCTOR).text
    table = client.get("/class", headers=INSTRUCTOR).json()
    assert [(each["trainee"], each["best"], each["attempts"]) for each in table] == [("heron-17", 220.0, 1)]


def test_what_is_too_long_is_refused_in_a_sentence(client: httpx.Client) -> None:
    for path in ("/picture", "/last-picture/20261130T1-a"):
        answer = client.put(path, content=b"x" * ((1 << 20) + 1), headers=TRAINEE)
        assert (answer.status_code, "bytes are not taken" in answer.json()["error"]) == (400, True)
    assert client.get("/pulse", headers=TRAINEE).status_code == 200


@pytest.mark.parametrize("number", [0, 10**9, 10**30])
def test_an_attempt_that_is_not_there_is_told(client: httpx.Client, number: int) -> None:
    for answer in (
        client.get(f"/attempts/{number}", headers=TRAINEE),
        client.post(f"/attempts/{number}/bookmark", content=b'{"words": "here"}', headers=INSTRUCTOR),
    ):
        assert (answer.status_code, "attempt" in answer.json()["error"]) == (409, True)


def test_a_full_disk_is_told_and_ends_nothing(
    client: httpx.Client, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(bench.replays, "keep", full)
    answer = client.put("/replay/20261130T1-a", content=b"pictures", headers=TRAINEE)
    assert (answer.status_code, "No space left" in answer.json()["error"]) == (507, True)
    assert client.get("/pulse", headers=TRAINEE).status_code == 200


def test_a_picture_is_sent_only_while_somebody_looks(client: httpx.Client) -> None:
    assert not client.get("/pulse", headers=TRAINEE).json()["watched"]
    assert client.get("/picture", headers=TRAINEE).status_code == 403
    assert client.get("/picture", headers=INSTRUCTOR).status_code == 404
    assert client.get("/pulse", headers=TRAINEE).json()["watched"]
    client.put("/picture", content=b"jpeg", headers=TRAINEE)
    assert client.get("/picture", headers=INSTRUCTOR).content == b"jpeg"


def test_bad_requests_get_a_sentence(client: httpx.Client) -> None:
    assert client.post("/enter", json={"trainee": "no such name!"}, headers=TRAINEE).status_code == 409
    assert client.post("/enter", content=b"{", headers=TRAINEE).status_code == 400
    assert client.get("/attempts/99", headers=TRAINEE).json() == {"error": "there is no attempt 99"}
    error = client.post("/course", json={"course": "nowhere"}, headers=TRAINEE).json()["error"]
    assert "nowhere" in error
    assert courses.course_names()[0] in error
