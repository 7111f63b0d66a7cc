"""Bad input: one clear sentence, a non-zero exit code, no traceback."""

from __future__ import annotations

import errno
import math
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import Trocar
from trocar.services.runtime.config import config

ROOT = Path(__file__).parents[2]


def test_malformed_yaml(trocar: Trocar, tmp_path: Path) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text("name: bad\nprocesses: [gateway\n")
    ran = trocar("up", "--rig", file)
    assert ran.code == 2
    assert str(file) in ran.sentence()
    assert "line" in ran.sentence()


def test_unknown_key_names_the_known_ones(trocar: Trocar, rig_file: Path) -> None:
    rig_file.write_text(rig_file.read_text() + "recorder: {folder: here}\n")
    ran = trocar("up", "--rig", rig_file)
    assert ran.code == 2
    assert "recorder.folder: unknown key 'folder'; known: " in ran.sentence()


def test_unknown_rig_names_the_known_ones(trocar: Trocar) -> None:
    ran = trocar("up", "--rig", "moon")
    assert ran.code == 2
    assert "known: " in ran.sentence()
    assert "stub" in ran.sentence()


def test_missing_scene(trocar: Trocar, rig_file: Path, tmp_path: Path) -> None:
    ran = trocar("up", "--rig", rig_file, "--scene", tmp_path / "none.yaml")
    assert ran.code == 2
    assert "there is no such scene file" in ran.sentence()


def test_bad_override(trocar: Trocar, rig_file: Path) -> None:
    ran = trocar("up", "--rig", rig_file, "--set", "supervisor.window_s=soon")
    assert ran.code == 2
    assert "supervisor.window_s" in ran.sentence()


def test_port_taken(trocar: Trocar, rig_file: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        ran = trocar("up", "--rig", rig_file, "--set", f"supervisor.web.port={port}")
    assert ran.code == 3
    assert f"127.0.0.1:{port}: address already in use" in ran.sentence()
    assert "--set supervisor.web.port=" in ran.sentence()


@pytest.mark.parametrize("how", ["a file", "below a file", "closed", "others may replace it"])
def test_a_folder_that_cannot_keep_recordings_is_refused_before_anything_starts(
    trocar: Trocar, rig_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    """The whole rig was started, for its recorder to refuse it then."""
    file, closed, unsafe = tmp_path / "file", tmp_path / "closed", tmp_path / "open"
    file.touch()
    closed.mkdir()
    unsafe.mkdir()
    unsafe.chmod(0o777)
    may, accepts = os.access, "recorder.shared: true accepts that"
    monkeypatch.setattr(os, "access", lambda path, mode, **more: path != closed and may(path, mode, **more))
    folder, why = {
        "a file": (file, f"{file} is a file, not a folder"),
        "below a file": (file / "a" / "b", f"{file} is a file, not a folder"),
        "closed": (closed / "a", f"this user may not write to {closed}"),
        "others may replace it": (unsafe / "a", f"others may write to {unsafe} (mode 0777); {accepts}"),
    }[how]
    ran = trocar("up", "--rig", rig_file, "--set", f"recorder.directory={folder}")
    assert (ran.code, ran.sentence()) == (5, f"recorder.directory {folder}: {why}")
    assert [each.name for each in rig_file.parent.iterdir()] == [rig_file.name], "nothing was made"


def test_no_display(trocar: Trocar, rig_file: Path) -> None:
    ran = trocar("up", "--rig", rig_file, "--viewer", "native")
    assert ran.code == 4
    assert "there is no display" in ran.sentence()


def test_report_into_a_folder_that_is_not_there(trocar: Trocar, rig_file: Path, tmp_path: Path) -> None:
    ran = trocar("up", "--rig", rig_file, "--json", tmp_path / "none" / "run.json")
    assert ran.code == 2
    assert "there is no folder" in ran.sentence()


def test_unknown_topic(trocar: Trocar, rig_file: Path) -> None:
    ran = trocar("sniff", "gateway.stat", "--rig", rig_file)
    assert ran.code == 2
    assert "known: gateway.state" in ran.sentence()


@pytest.mark.parametrize("command", [("sniff", "--seconds", "0.2"), ("top", "--once", "--seconds", "0.3"), ("arm",)])
def test_no_rig_is_running(trocar: Trocar, rig_file: Path, command: tuple[str, ...]) -> None:
    ran = trocar(*command, "--rig", rig_file)
    assert ran.code == 3
    assert "running" in ran.sentence()


@pytest.mark.parametrize("command", ["up", "top", "sniff"])
def test_a_time_without_an_end_is_a_usage_error(trocar: Trocar, rig_file: Path, command: str) -> None:
    ran = trocar(command, "--rig", rig_file, "--seconds", "inf")
    assert ran.code == 2
    assert "inf is no length of time" in ran.err


def test_no_minutes_are_not_any_number_of_minutes(trocar: Trocar, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nought was taken for nothing said, and all cases were run."""
    given: list[float] = []
    monkeypatch.setattr(
        "trocar.studies.commands.stability.run_suite", lambda *arguments: given.append(arguments[-1]) or []
    )
    assert trocar("stability", "--minutes", "0").code == 0
    assert trocar("stability").code == 0
    assert given == [0.0, math.inf]


def test_a_study_of_two_sizes_is_a_usage_error(trocar: Trocar) -> None:
    """It was taken for the smallest, whose numbers mean nothing."""
    ran = trocar("study", "modes", "--quick", "--smallest")
    assert ran.code == 2
    assert "say one of them" in ran.err


@pytest.mark.parametrize(
    ("command", "where"),
    [
        (("keys", ""), "an argument"),
        (("study", "element", "--out", ""), "--out"),
        (("stability", "--out="), "--out="),
        (("repair", ""), "an argument"),
        (("config", "show", "--set", ""), "--set"),
    ],
)
def test_a_variable_of_the_shell_that_is_not_set_is_no_place(
    trocar: Trocar, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, command: tuple[str, ...], where: str
) -> None:
    """The keys of a rig were written into the present folder."""
    monkeypatch.chdir(tmp_path)
    ran = trocar(*command)
    assert (ran.code, ran.sentence()) == (2, f"{where} is empty; the present folder is called '.'")
    assert not list(tmp_path.iterdir())


def test_a_present_folder_that_is_gone_is_one_sentence(
    trocar: Trocar, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    ran = trocar("fem", ROOT / "configs/fem/incised-duct.yaml", "--json", "out.json")
    assert (ran.code, ran.sentence()) == (2, "the present folder is gone; `cd` to one that is there")


def test_a_closed_folder_is_one_sentence(trocar: Trocar, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As of a cache, a log or a scene that belongs to somebody else, whichever verb comes upon it."""

    def closed(*arguments: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", str(tmp_path))

    monkeypatch.setattr(config, "read_yaml", closed)
    ran = trocar("config", "show", "--scene", "insertion")
    assert (ran.code, ran.sentence()) == (2, f"{tmp_path}: permission denied")


def test_arm_where_nobody_answers(trocar: Trocar) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound, not listening: refused
        ran = trocar("arm", "--address", f"http://127.0.0.1:{taken.getsockname()[1]}")
    assert ran.code == 3
    assert "no supervisor answers" in ran.sentence()


@pytest.mark.parametrize("command", ["arm", "safe-stop"])
def test_a_rig_is_looked_for_where_the_options_put_it(trocar: Trocar, tmp_path: Path, command: str) -> None:
    """As by the other verbs: these had no --set, and found no rig that was started with one."""
    ran = trocar(command, "--set", f"transport.directory={tmp_path}")
    assert (ran.code, str(tmp_path / "supervisor.control") in ran.sentence()) == (3, True)


def test_address_that_is_none(trocar: Trocar) -> None:
    assert trocar("arm", "--address", "nonsense").code == 3


def test_down_of_nothing_is_no_error(trocar: Trocar, rig_file: Path) -> None:
    ran = trocar("down", "--rig", rig_file)
    assert (ran.code, ran.err.strip()) == (0, "no rig is running")


def test_missing_mesh(trocar: Trocar, rig_file: Path) -> None:
    scene = rig_file.parent / "scene.yaml"
    scene.write_text("duct: {mesh_file: nowhere/duct.stl}\n")
    ran = trocar("up", "--rig", rig_file, "--scene", scene)
    assert ran.code == 2
    assert "nowhere/duct.stl" in ran.sentence()


def test_missing_vendor_library(rig_file: Path) -> None:
    """The sentence comes from the gateway, which loads what drives its arms when it opens them, as a user sees it."""
    arm = "{driver: phantom_hdapi, device: touch, settings: {library: libHD-that-nobody-has.so}}"
    instrument = f"{{name: left, port_m: [0.0, 0.0, 0.1], arm: {arm}}}"
    others = ", ".join(f"{name}: {{enabled: false}}" for name in ("visualization", "physics", "haptics", "recorder"))
    rig_file.write_text(f"{rig_file.read_text()}processes: {{{others}}}\ngateway: {{instruments: [{instrument}]}}\n")
    command = [sys.executable, "-m", "trocar.services.cli.app", "up", "--rig", str(rig_file)]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, cwd=ROOT)
    assert ran.returncode == 4, ran.stderr
    assert "instrument 'left': OpenHaptics cannot be loaded: libHD-that-nobody-has.so" in ran.stderr
    assert ran.stderr.strip().count("\n") == 0, ran.stderr
