"""A database with bytes that nobody wrote: each thing is done or refused in a sentence, and what is whole is there."""

from __future__ import annotations

import functools
import json
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import text
from typer.testing import CliRunner

from tests.by_day import by_day
from tests.review.benches import made_up
from trocar.review.attempts.store.attempts import Store, StoreError
from trocar.services.cli.app import add_installed_verbs, app

ATTEMPTS = 40
#: SQLite damages a file of its own in none of these ways; each is a byte or more that a disk or a person changed.
SPOILS = {
    "a byte of the assessment": "UPDATE attempts SET assessment = x'789c0000' || substr(assessment, 5) WHERE id = 7",
    "text for the assessment": "UPDATE attempts SET assessment = 'nothing' WHERE id = 7",
    "no number for a time": "UPDATE attempts SET time_s = 'soon' WHERE id = 7",
    "no number for the moment": "UPDATE attempts SET began_ns = 'then' WHERE id = 7",
    "bytes for the recording": "UPDATE attempts SET recording = x'ff00' WHERE id = 7",
    "bytes for the outcome": "UPDATE attempts SET outcome = x'ff00' WHERE id = 7",
}


def made(path: Path) -> Path:
    with Store(str(path)) as store:
        for k in range(ATTEMPTS):
            store.add(made_up(str(k)), f"heron-{k % 4}", path.with_name(f"{k}.mcap"))
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("whole") / "a.sqlite")


@pytest.mark.parametrize("spoil", SPOILS)
def test_a_damaged_row_is_told_and_all_others_are_read(tmp_path: Path, whole: Path, spoil: str) -> None:
    """zlib.error was raised, and nobody's attempts could be exported."""
    path = Path(shutil.copy(whole, tmp_path / "a.sqlite"))
    told: list[str] = []
    with Store(str(path), tell=told.append) as store:
        with store._engine.begin() as connection:
            connection.execute(text(SPOILS[spoil]))
        exported = json.loads(store.export())["attempts"]
        assert {each["attempt_id"] for each in exported} >= {str(k) for k in range(ATTEMPTS) if k != 6}
        assert len(store.table().splitlines()) == 1 + len(exported)
        assert len(store.listed()) >= ATTEMPTS - 1
        assert len(store.past("heron-1", "basic", 10)) == 10
        assert len(store.last_totals(["heron-1"])) == 0
        assert store.assessment(8)[1] == "heron-3"
        if len(exported) < ATTEMPTS:
            assert told
            assert set(told) == {
                "attempt 7 cannot be read: the database is damaged there; `trocar score` of its recording keeps it anew"
            }
            with pytest.raises(StoreError, match=r"^attempt 7 cannot be read"):
                store.assessment(7)
        assert store.add(made_up("6"), "heron-2", tmp_path / "6.mcap") == 7, "judged again it is whole"
        assert len(json.loads(store.export())["attempts"]) == ATTEMPTS


def test_what_is_damaged_is_told_by_the_command_and_the_rest_is_written(tmp_path: Path, whole: Path) -> None:
    path = Path(shutil.copy(whole, tmp_path / "a.sqlite"))
    with Store(str(path)) as store, store._engine.begin() as connection:
        connection.execute(text("UPDATE attempts SET assessment = x'00' WHERE id IN (3, 7)"))
    add_installed_verbs()
    ran = CliRunner().invoke(app, ["attempts", "export", "--database", str(path)], catch_exceptions=False)
    assert ran.exit_code == 0
    assert ran.stderr.startswith("trocar: attempts 3, 7 cannot be read: the database is damaged there;")
    assert len(json.loads(ran.stdout)["attempts"]) == ATTEMPTS - 2


def _for_report(store: Store) -> object:
    found, trainee = store.assessment(8)
    return store.past(trainee, found.scenario, found.began_ns)


_DONE: dict[str, Callable[[Store], object]] = {
    "listed": lambda store: store.listed(),
    "exported": lambda store: store.export(),
    "exported of one": lambda store: store.export("heron-1"),
    "as a table": lambda store: store.table(),
    "for a report": _for_report,
    "scores": lambda store: store.last_totals(["heron-1", "heron-2"]),
    "added": lambda store: store.add(made_up("new"), "heron-1", Path("/nowhere/new.mcap")),
    "judged again": lambda store: store.add(made_up("6"), "heron-2", Path("/nowhere/6.mcap")),
    "planned": lambda store: store.plan_erasure("heron-3"),
    "erased": lambda store: store.erase_with_recordings("heron-3"),
}


@pytest.mark.parametrize("seed", by_day(range(30), range(30, 1000)))
def test_bytes_that_are_flipped_anywhere_are_a_sentence_at_most(tmp_path: Path, whole: Path, seed: int) -> None:
    """A sentence names the database, or a row; nothing else is raised, and no other row is lost for it."""
    chance = np.random.default_rng(seed)
    data = bytearray(whole.read_bytes())
    first = 0 if chance.random() < 0.2 else 100  # by and large behind the head, which is all or nothing
    for place in chance.integers(first, len(data), chance.integers(1, 30)):
        data[place] ^= 1 << int(chance.integers(8))
    path = tmp_path / "a.sqlite"
    path.write_bytes(data)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # what is told of rows
        for what in chance.permutation(list(_DONE)):
            said = _refusal(functools.partial(_do, path, what))
            assert "\n" not in said
            assert len(said) < 400


def _do(path: Path, what: str) -> None:
    with Store(str(path)) as store:
        _DONE[what](store)


def _refusal(act: Callable[[], None]) -> str:
    try:
        act()
    except StoreError as error:
        return str(error)
    return ""
