"""What a verb writes: refused before it begins, whole or not at all, and nothing found is lost when it cannot be."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from services.cli import targets
from services.runtime.errors import ConfigError, UserError
from tests.cli.conftest import Trocar

PLATE = """
mesh: {parametric: {radius_m: 0.004, length_m: 0.02, n_around: 8, n_along: 4}}
thickness_m: 0.0005
material: {youngs_modulus_pa: 100.0e+3, poisson_ratio: 0.45, density_kg_m3: 1060.0}
supports: [{where: {vertex_set: clamped}}]
loads: [{acceleration_m_s2: [0.0, 0.0, -9.81]}]
"""


@pytest.fixture
def case(tmp_path: Path) -> Path:
    file = tmp_path / "case.yaml"
    file.write_text(PLATE)
    return file


@pytest.mark.parametrize("option", ["--json", "--vtu"])
def test_a_full_disk_loses_nothing_that_was_found(trocar: Trocar, case: Path, option: str) -> None:
    ran = trocar("fem", case, option, "/dev/full")
    assert ran.code == 1
    assert ran.sentence() == f"{option} /dev/full: cannot be written: No space left on device"
    assert "reaction force N" in ran.out


@pytest.mark.parametrize(
    "command",
    [
        ("fem", "{case}", "--json", "{folder}"),
        ("fem", "{case}", "--vtu", "{folder}"),
        ("haptics", "--out", "{folder}"),
        ("stability", "--report", "{folder}"),
        ("study", "element", "--out", "{folder}/study", "--report", "{folder}"),
        ("latency", "--trace", "{folder}"),
        ("up", "--json", "{folder}"),
    ],
)
def test_a_folder_is_no_file(trocar: Trocar, case: Path, command: tuple[str, ...]) -> None:
    ran = trocar(*(part.format(case=case, folder=case.parent) for part in command))
    assert ran.code == 2
    assert ran.sentence() == f"{command[-2]} {case.parent}: is a folder, not a file"


@pytest.mark.parametrize("command", [("study", "element"), ("stability",)])
def test_a_file_is_no_folder(trocar: Trocar, case: Path, command: tuple[str, ...]) -> None:
    ran = trocar(*command, "--out", case)
    assert (ran.code, ran.sentence()) == (2, f"--out {case}: is a file, not a folder")


def test_a_file_that_cannot_be_replaced_stays_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "kept.json"
    targets.write_text("--json", file, json.dumps("first"))

    def refuse(*_: object) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(UserError, match=r"^--json .*: cannot be written: No space left on device$"):
        targets.write_text("--json", file, json.dumps("second"))
    assert [each.name for each in tmp_path.iterdir()] == ["kept.json"]
    assert json.loads(file.read_text()) == "first"


def test_a_link_to_a_device_is_written_to_and_stays(tmp_path: Path) -> None:
    """As `--json /dev/stdout` is: a link that a file put in its place would take from everybody."""
    link = tmp_path / "null"
    link.symlink_to("/dev/null")
    targets.write_text("--json", link, "gone")
    assert link.is_symlink()


def test_a_link_to_a_file_is_written_through(tmp_path: Path) -> None:
    """As /dev/stdout is where the output goes to a file: in its place there was a file in /dev, for everybody."""
    link, file = tmp_path / "link", tmp_path / "folder" / "out.json"
    file.parent.mkdir()
    file.touch()
    link.symlink_to(file)
    targets.write_text("--json", link, "found")
    assert link.is_symlink()
    assert file.read_text() == "found"


def test_a_file_in_a_closed_folder_is_written_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "out.json"
    file.touch()
    monkeypatch.setattr(os, "access", lambda path, _mode: Path(path) != tmp_path)
    monkeypatch.setattr(Path, "replace", lambda *_: pytest.fail("nobody may make a file there"))
    targets.look_at_file("--json", file)
    targets.write_text("--json", file, "found")
    assert file.read_text() == "found"


def test_what_this_user_may_not_write_is_refused_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(ConfigError, match=r"^--json .*/new.json: this user may not write .*[^n]$"):
        targets.look_at_file("--json", tmp_path / "new.json")
    with pytest.raises(ConfigError, match=r"^--out .*: this user may not write there$"):
        targets.make_folder("--out", tmp_path)
