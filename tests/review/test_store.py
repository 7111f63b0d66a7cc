"""Attempts in a database: kept once, listed, exported, erased without a trace; the same through the command line.

In SQLite and, where Debian's package is installed, in PostgreSQL.
"""

from __future__ import annotations

import csv
import json
import re
import sys
import threading
from itertools import chain
from pathlib import Path

import msgspec
import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import create_engine, event, insert, inspect
from typer.testing import CliRunner

from tests.review.test_assess import recorded
from tests.training.streams import GOOD, messages
from trocar.review.attempts.assessment import Assessment
from trocar.review.attempts.store.attempts import Store, StoreError
from trocar.review.attempts.store.tables import Base, StoredAttempt, Trainee
from trocar.services.cli.app import add_installed_verbs, app
from trocar.services.runtime.errors import MissingPackageError

RUN = CliRunner()
ATTEMPTS, TRAINEES = 10_000, 100


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "sqlite":
        return str(tmp_path / "a.sqlite")
    made: str = request.getfixturevalue("new_postgres")()
    return made


def later(attempt: Assessment, seconds: int) -> Assessment:
    return msgspec.structs.replace(
        attempt, began_ns=attempt.began_ns + seconds * 1_000_000_000, attempt_id=str(seconds)
    )


def test_what_is_kept_comes_back(tmp_path: Path, url: str, attempt: Assessment) -> None:
    with Store(url) as store:
        number = store.add(attempt, "heron-17", tmp_path / "a.mcap")
        assert store.assessment(number) == (attempt, "heron-17")
        (row,) = store.listed()
        assert (row.id, row.trainee, row.outcome, row.time_s) == (number, "heron-17", "success", 2.0)
        with pytest.raises(StoreError, match="there is no attempt 99"):
            store.assessment(99)


def test_an_attempt_that_is_judged_again_is_kept_once(tmp_path: Path, url: str, attempt: Assessment) -> None:
    with Store(url) as store:
        numbers = {store.add(each, "heron-17", tmp_path / "a.mcap") for each in (attempt, attempt)}
        assert len(numbers) == 1
        assert store.add(later(attempt, 60), "heron-17", tmp_path / "b.mcap") not in numbers
        assert [row.id for row in store.listed("heron-17", attempt.scenario)] == [1, 2]
        assert store.listed("wren-2") == store.listed("heron-17", "narrow") == []
        assert [each.time_s for each in store.past("heron-17", attempt.scenario, attempt.began_ns)] == [2.0]


def test_a_trainee_is_erased_without_a_trace(tmp_path: Path, attempt: Assessment) -> None:
    path, recording = tmp_path / "a.sqlite", tmp_path / "a.mcap"
    recording.touch()
    with Store(str(path)) as store:
        store.add(attempt, "heron-17", recording)
        store.add(later(attempt, 60), "wren-2", tmp_path / "gone.mcap")
        assert b"heron-17" in path.read_bytes()
        assert store.erase("heron-17") == [recording]
        assert [row.trainee for row in store.listed()] == ["wren-2"]
        with pytest.raises(StoreError, match="there is no trainee 'heron-17'"):
            store.erase("heron-17")
    assert b"heron-17" not in path.read_bytes()
    assert str(recording).encode() not in path.read_bytes()


def test_the_export_has_everything_of_one_trainee(tmp_path: Path, url: str, attempt: Assessment) -> None:
    with Store(url) as store:
        store.add(attempt, "heron-17", tmp_path / "a.mcap")
        store.add(later(attempt, 60), "wren-2", tmp_path / "b.mcap")
        (mine,) = json.loads(store.export("heron-17"))["attempts"]
        assert (mine["trainee"], mine["counts"], mine["metrics"]) == ("heron-17", True, attempt.metrics)
        assert len(json.loads(store.export())["attempts"]) == 2
        with pytest.raises(StoreError, match="there is no trainee 'nobody'"):
            store.export("nobody")
        first, second = csv.DictReader(store.table().splitlines())
        assert (first["trainee"], second["trainee"]) == ("heron-17", "wren-2")
        assert float(first["right.path_m"]) == attempt.metrics["right.path_m"]


def test_the_migrations_make_the_tables_that_the_code_has(url: str) -> None:
    for _ in range(2):
        with Store(url) as store:
            store.listed()
    engine = create_engine(url if "://" in url else f"sqlite:///{url}")
    with engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Base.metadata) == []
    engine.dispose()


@pytest.mark.parametrize("kind", ["sqlite", "postgresql", "empty file"])
def test_threads_that_open_an_empty_database_at_once_make_its_tables_once(
    kind: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """Alembic keeps what it does in names that all threads share: nine classes of eleven died of it."""
    address = str(tmp_path / "a.sqlite")
    if kind == "postgresql":
        address = request.getfixturevalue("new_postgres")()
    elif kind == "empty file":
        Path(address).touch()
    errors: list[BaseException] = []
    listed: list[object] = []

    def open_it() -> None:
        try:
            together.wait()
            with Store(address) as store:
                listed.append(store.listed())
        except BaseException as error:
            errors.append(error)

    together = threading.Barrier(8)
    threads = [threading.Thread(target=open_it) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (errors, listed) == ([], [[]] * 8)


def test_a_migration_that_breaks_leaves_nothing_and_the_next_one_is_whole(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("the power went off")

    with monkeypatch.context() as broken:
        broken.setattr("alembic.op.create_index", fail)
        with pytest.raises(RuntimeError, match="the power went off"):
            Store(url)
    with Store(url) as store:
        assert store.listed() == []


def test_a_trainee_is_erased_and_nobody_else(url: str, tmp_path: Path, attempt: Assessment) -> None:
    with Store(url) as store:
        store.add(attempt, "heron-17", tmp_path / "a.mcap")
        store.add(later(attempt, 60), "wren-2", tmp_path / "b.mcap")
        store.erase("heron-17")
        assert [row.trainee for row in store.listed()] == ["wren-2"]
        with pytest.raises(StoreError, match="there is no trainee 'heron-17'"):
            store.export("heron-17")


def test_ten_thousand_are_listed_by_one_question_that_reads_no_assessment(url: str) -> None:
    """How fast is `benchmarks/bench_training.py`'s to say."""
    row = {
        "scenario": "basic", "outcome": "success", "counts": True, "time_s": 20.0, "total": 250.0, "percent": None,
        "errors": 2, "critical": 0, "recording": "a.mcap", "assessment": b"nothing that could be unpacked",
    }  # fmt: skip
    with Store(url) as store:
        with store._engine.begin() as connection:
            connection.execute(insert(Trainee), [{"pseudonym": f"heron-{k}"} for k in range(TRAINEES)])
            rows = [row | {"trainee_id": 1 + k % TRAINEES, "key": f"{k}", "began_ns": -k} for k in range(ATTEMPTS)]
            connection.execute(insert(StoredAttempt), rows)
        asked: list[str] = []
        event.listen(store._engine, "before_cursor_execute", lambda *said: asked.append(said[2]))
        listed = store.listed()
        assert [each.began_ns for each in listed] == list(range(1 - ATTEMPTS, 1))
        assert len(asked) == 1
        assert "assessment" not in asked[0]
        assert len(store.listed("heron-7")) == ATTEMPTS // TRAINEES


def test_the_report_of_who_made_a_hundred_shows_them_all(url: str, tmp_path: Path, attempt: Assessment) -> None:
    with Store(url) as store:
        for k in range(100):
            number = store.add(later(attempt, k), "heron-17", tmp_path / "a.mcap")
    out = tmp_path / "report.html"
    run("report", str(number), "--database", url, "--out", str(out))
    html = out.read_text()
    assert "heron-17" in html
    curves = [points.split() for points in re.findall(r'<polyline class="curve c0" points="([^"]*)"', html)]
    assert [len(points) for points in curves].count(100) == 3, "time, score and CUSUM over the attempts"


@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("nonsense://x", "the address of the database cannot be read"),
        ("postgresql+psycopg://me:secret@localhost/x", "the database needs the package 'psycopg': "),
        ("/dev/null/a/a.sqlite", "/dev/null/a: not a directory"),
        ("/proc/a.sqlite", "sqlite:////proc/a.sqlite: unable to open database file"),
    ],
)
def test_a_database_that_cannot_be_used_is_one_sentence(url: str, says: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises((StoreError, MissingPackageError), match=says) as caught:
        Store(url)
    assert "secret" not in str(caught.value)


def test_something_that_is_no_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    path.write_bytes(b"this is no database, but it is long enough to be looked at" * 20)
    with pytest.raises(StoreError, match="file is not a database"):
        Store(str(path))


@pytest.mark.parametrize(
    "command",
    [
        ("attempts", "list"), ("attempts", "curve", "heron-17", "basic"), ("attempts", "export"),
        ("attempts", "erase", "heron-17", "--yes"), ("report", "1"),
    ],
)  # fmt: skip
def test_a_database_that_is_not_there_is_no_empty_one(tmp_path: Path, command: tuple[str, ...]) -> None:
    place = tmp_path / "folder" / "a.sqlite"
    add_installed_verbs()
    ran = RUN.invoke(app, [*command, "--database", str(place)])
    assert isinstance(ran.exception, StoreError)
    assert f"there is no database of attempts at {place}" in str(ran.exception)
    assert "attempts" not in ran.stdout
    assert not place.parent.exists(), "to look makes nothing"


def test_a_database_of_a_newer_version_is_one_sentence_and_the_score_is_shown(url: str, tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap", chain(messages(GOOD, 3.0)))
    with Store(url) as store, store._engine.begin() as connection:
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = '0099'")
    says = r"its tables are of version '0099', which a newer Trocar wrote; this one knows them up to '0002'"
    with pytest.raises(StoreError, match=says) as caught:
        Store(url)
    assert "\n" not in str(caught.value)
    add_installed_verbs()
    ran = RUN.invoke(app, ["score", str(path), "--trainee", "heron-17", "--database", url])
    assert isinstance(ran.exception, StoreError)
    assert str(ran.exception).startswith("not kept: ")
    assert "incomplete after 3.0 s" in ran.stdout


def test_a_database_of_another_program_is_left_alone(tmp_path: Path) -> None:
    engine = create_engine(f"sqlite:///{tmp_path / 'places.sqlite'}")
    with engine.begin() as connection:
        connection.exec_driver_sql("CREATE TABLE bookmarks (id INTEGER)")
    with pytest.raises(StoreError, match="is no database of attempts, but has tables of another program: bookmarks"):
        Store(str(tmp_path / "places.sqlite"))
    with engine.connect() as connection:
        assert inspect(connection).get_table_names() == ["bookmarks"]
    engine.dispose()


def test_an_attempt_that_goes_to_another_trainee_is_told(
    tmp_path: Path, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TROCAR_ATTEMPTS", url)
    path = recorded(tmp_path / "a.mcap", chain(messages(GOOD, 3.0)))
    assert "was kept as" not in run("score", str(path), "--trainee", "heron-17")
    assert "was kept as" not in run("score", str(path), "--trainee", "heron-17")
    said = run("score", str(path), "--trainee", "wren-2")
    assert "attempt 1 was kept as heron-17's; it is wren-2's now" in said


@pytest.mark.parametrize("number", ["0", "7", "99999999999999999999999"])
def test_a_number_that_no_attempt_has_is_a_sentence(url: str, number: str) -> None:
    with Store(url) as store, pytest.raises(StoreError, match=f"^there is no attempt {number}$"):
        store.assessment(int(number))


def test_a_name_that_is_no_pseudonym_is_refused(tmp_path: Path, attempt: Assessment) -> None:
    with Store(str(tmp_path / "a.sqlite")) as store, pytest.raises(StoreError, match="'Ada Lovelace' is no pseudonym"):
        store.add(attempt, "Ada Lovelace", tmp_path / "a.mcap")


def run(*arguments: str) -> str:
    add_installed_verbs()
    result = RUN.invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_recording_from_score_to_erasure_through_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TROCAR_ATTEMPTS", str(tmp_path / "a.sqlite"))
    path = recorded(tmp_path / "a.mcap", chain(messages(GOOD, 3.0)))
    assert "incomplete after 3.0 s, score none" in run("score", str(path))
    (scored,) = json.loads(run("score", str(path), "--trainee", "heron-17", "--json"))["attempts"]
    assert scored["outcome"] == "incomplete"
    (listed,) = json.loads(run("attempts", "list", "--json"))["attempts"]
    assert "heron-17" in run("attempts", "list")
    out = tmp_path / "report.html"
    for what in (str(path), str(listed["id"])):
        run("report", what, "--out", str(out))
        assert "incomplete: the recording ends before the attempt" in out.read_text()
    run("attempts", "export", "heron-17", "--out", str(tmp_path / "mine.json"))
    assert len(json.loads((tmp_path / "mine.json").read_text())["attempts"]) == 1
    assert "heron-17: 1 attempt erased" in run("attempts", "erase", "heron-17", "--recordings", "--yes")
    assert not path.exists()
    assert json.loads(run("attempts", "list", "--json"))["attempts"] == []


def test_the_curve_of_a_trainee_is_shown(tmp_path: Path, url: str, attempt: Assessment) -> None:
    with Store(url) as store:
        for k in range(6):
            slower = msgspec.structs.replace(later(attempt, k), time_s=40.0 + 20.0 / (k + 1))
            store.add(slower, "heron-17", tmp_path / "a.mcap")
    shown = json.loads(run("attempts", "curve", "heron-17", attempt.scenario, "--database", url, "--json"))
    assert shown["time_s"][0] == 60.0
    assert shown["learning"]["plateau"] == pytest.approx(40.0, abs=0.5)
    assert len(shown["cusum"]["values"]) == 6
    assert "power law of practice" in run("attempts", "curve", "heron-17", attempt.scenario, "--database", url)
