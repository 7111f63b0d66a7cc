"""What a verb writes: refused before it begins, whole or not at all, and nothing found is lost when it cannot be."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import Trocar
from trocar.services.cli import targets
from trocar.services.runtime.errors import ConfigError, UserError

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
        ("diagnose", "latency", "--trace", "{folder}"),
        ("up", "--json", "{folder}"),
    ],
)
def test_a_folder_is_no_file(trocar: Trocar, case: Path, command: tuple[str, ...]) -> None:
    ran = trocar(*(part.format(case=case, folder=case.parent) for part in command))
    assert ran.code == 2
    assert ran.sentence() == f"{command[-2]} {case.parent}: is a folder, not a file"


@pytest.mark.parametrize("command", [("haptics", "--out"), ("study", "element", "--out", "{folder}", "--report")])
@pytest.mark.parametrize("name", ["page", ".md", "folder/page"])
def test_a_page_whose_figures_would_lie_in_its_place_is_refused_before(
    trocar: Trocar, tmp_path: Path, command: tuple[str, ...], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was refused in the end, after an hour of computing: the folder of its figures had its name."""
    monkeypatch.setattr("trocar.services.cli.targets.writing", lambda *_: pytest.fail("it computed"))
    ran = trocar(*(part.format(folder=tmp_path / "study") for part in command), tmp_path / name)
    assert ran.code == 2
    assert ran.sentence().startswith(f"{command[-1]} {tmp_path / name}: needs an ending")
    assert not (tmp_path / name).exists()


@pytest.mark.parametrize(
    ("command", "beside"),
    [
        (("haptics", "--out"), "page/running.json"),
        (("study", "element", "--out", "{folder}", "--report"), "page/mesh.json"),
    ],
)
def test_what_lies_beside_a_page_and_cannot_be_read_is_refused_before(
    trocar: Trocar, tmp_path: Path, command: tuple[str, ...], beside: str
) -> None:
    (tmp_path / "page").mkdir()
    (tmp_path / beside).write_text("{")
    ran = trocar(*(part.format(folder=tmp_path / "study") for part in command), tmp_path / "page.md")
    assert ran.code in (1, 2)
    assert beside.partition("/")[2] in ran.sentence()


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


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (("--json", "case.yaml"), "--json case.yaml: is the case itself"),
        (("--vtu", "./case.yaml"), "--vtu case.yaml: is the case itself"),
        (("--json", "out", "--vtu", "out"), "--vtu out: is what --json writes"),
    ],
)
def test_nothing_that_is_read_is_written_over(
    trocar: Trocar, case: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], why: str
) -> None:
    """A case was lost to its own result."""
    monkeypatch.chdir(case.parent)
    ran = trocar("fem", "case.yaml", *options)
    assert (ran.code, ran.sentence()) == (2, why)
    assert case.read_text() == PLATE
    assert list(case.parent.iterdir()) == [case]


def test_the_mesh_is_not_written_over(trocar: Trocar, case: Path) -> None:
    mesh = case.parent / "plate.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    case.write_text(
        PLATE.replace(
            "parametric: {radius_m: 0.004, length_m: 0.02, n_around: 8, n_along: 4}",
            "surface_file: {path: plate.obj, units: m}",
        )
    )
    assert trocar("fem", case, "--vtu", mesh).sentence() == f"--vtu {mesh}: is the case's mesh"


def test_a_number_in_a_narrow_terminal_keeps_its_exponent(
    trocar: Trocar, case: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was cut off behind some digits: 0.0025 looked like 0.002, and 1e-19 like 1."""
    monkeypatch.setenv("COLUMNS", "40")
    ran = trocar("fem", case)
    assert "…" not in ran.out


def test_a_name_that_the_terminal_cannot_write_is_escaped(case: Path) -> None:
    case.write_text(PLATE + 'probes: {"wall \u2603": {vertex: 3}}\n')
    command = [sys.executable, "-m", "trocar.services.cli.app", "fem", str(case)]
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    ran = subprocess.run(
        command, capture_output=True, text=True, env=environment, check=False, cwd=Path(__file__).parents[2]
    )
    assert (ran.returncode, ran.stderr.strip()) == (0, "")
    assert r"wall \u2603" in ran.stdout
