"""What a study or a case leaves behind: each file whole or as it was, whenever the disk is full or the run is ended."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.by_day import by_day
from trocar.services.files.atomic_file import atomic_file, complete_lines
from trocar.services.mechanics.surface.tube import DuctGeometry, parametric_duct
from trocar.services.meshes.writing import write_vtu
from trocar.studies.accuracy.facts import Facts
from trocar.studies.accuracy.log import StudyLog
from trocar.studies.accuracy.report import write_report
from trocar.studies.accuracy.study import Cost, Draw, Error, Row, Size
from trocar.studies.accuracy.sweeps import modes
from trocar.studies.commands.study import write_results
from trocar.studies.stability import suite
from trocar.studies.stability.family import Reach

DRAW = Draw(Size.SMALLEST, 0)
ROWS = [Row("modes", "20 modes", "residual", "force", 1.0, "%", cost=Cost(1.0, 2.0, 0.1), choices={})]
WRITTEN = (
    *("table.csv", "run.json", "modes.svg", "modes.png", "index.html", "report.md", "report/modes.svg"),
    *("report/modes.json", "duct.vtu"),
)


def write_all(folder: Path) -> None:
    facts = Facts.collect("trocar study modes", "abc", DRAW, {})
    write_vtu(folder / "duct.vtu", parametric_duct(DuctGeometry(4e-3, 40e-3, 8, 6)), {})
    write_results(ROWS, ["modes"], facts, folder)
    write_report(ROWS, ["modes"], facts, folder, folder / "report.md")


@pytest.mark.parametrize("name", by_day(["table.csv", "index.html", "duct.vtu"], WRITTEN[1:4] + WRITTEN[5:8]))
def test_a_file_that_cannot_be_finished_stays_as_it_was(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every name is put in its place at the end: where that fails for one, what was there before is there."""
    monkeypatch.setattr(modes, "findings", lambda _: [])  # of one point there are none
    write_all(tmp_path)
    (tmp_path / name).write_text("as it was")
    replace = Path.replace

    def refuse(half: Path, target: Path) -> Path:
        if target == tmp_path / name:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return replace(half, target)

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(OSError, match="No space left"):
        write_all(tmp_path)
    assert (tmp_path / name).read_text() == "as it was"
    assert not [each for each in tmp_path.rglob(".*") if each.is_file()], "nothing half is left"


def test_what_fails_on_the_way_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    file.write_text("as it was")

    def write() -> None:
        with atomic_file(file) as half:
            half.write_text("ha")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write()
    assert [each.name for each in tmp_path.iterdir()] == ["a.txt"]
    assert file.read_text() == "as it was"


def test_a_run_that_was_ended_within_a_line_goes_on_before_it(tmp_path: Path) -> None:
    log = StudyLog(tmp_path, DRAW, "code")
    log.keep_errors("modes", "20", {"force": Error(1.0, "%")})
    with (tmp_path / "results.jsonl").open("a") as file:
        file.write('{"study": "mod')
    again = StudyLog(tmp_path, DRAW, "code")
    assert list(again.errors) == [("modes", "20")]
    again.keep_errors("modes", "40", {"force": Error(2.0, "%")})
    assert list(StudyLog(tmp_path, DRAW, "code").errors) == [("modes", "20"), ("modes", "40")]


def test_a_log_that_is_not_there_has_no_lines(tmp_path: Path) -> None:
    assert complete_lines(tmp_path / "results.jsonl") == []


@pytest.mark.parametrize("name", ["order.json", "results.jsonl"])
@pytest.mark.parametrize("text", [b"not json\n", b"\xff\xff\n", b'{"family": 1}\n'])
@pytest.mark.parametrize(
    "open_log",
    [
        lambda folder: StudyLog(folder, DRAW, "code"),
        lambda folder: suite.Log(folder, suite.Order(Reach.QUICK, 1, ("theory",)), "code"),
    ],
    ids=["study", "stability"],
)
def test_a_folder_with_what_is_not_ours_is_named(
    tmp_path: Path, name: str, text: bytes, open_log: Callable[[Path], object]
) -> None:
    """It was told as "Expecting value", or in a traceback."""
    (tmp_path / name).write_bytes(text)
    with pytest.raises(ValueError, match=re.escape(str(tmp_path))):
        open_log(tmp_path)
    assert (tmp_path / name).read_bytes() == text
