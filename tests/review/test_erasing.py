"""A trainee is erased: asked for, files before rows, nothing of anybody else, and again where it did not succeed."""

from __future__ import annotations

import json
import os
import pty
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.patience import PATIENCE_S
from tests.review.benches import made_up
from trocar.review.attempts.store.attempts import Store, StoreError
from trocar.services.cli.app import add_installed_verbs, app

RECORDING = b"\x89MCAP0\r\n and what was recorded"


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    return str(tmp_path / "a.sqlite") if request.param == "sqlite" else request.getfixturevalue("new_postgres")()


def keep(url: str, **recordings: Path) -> None:
    """Keep an attempt of each trainee (with digits for more of one) in a recording, made if it is not there."""
    with Store(url) as store:
        for name, path in recordings.items():
            if not os.path.lexists(path):
                path.write_bytes(RECORDING)
            store.add(made_up(name), name.rstrip("0123456789"), path)


def left(url: str) -> list[str]:
    with Store(url) as store:
        return [f"{row.trainee} {Path(row.recording).name}" for row in store.listed()]


def erase(url: str, *options: str, code: int = 0) -> tuple[str, str]:
    """Erase heron as a script does; return what is said and what is complained about."""
    add_installed_verbs()
    ran = CliRunner().invoke(app, ["attempts", "erase", "heron", "--database", url, *options])
    if ran.exception is not None and not isinstance(ran.exception, SystemExit):
        assert isinstance(ran.exception, StoreError), ran.exception
        assert ran.exception.exit_code == code
        return ran.stdout, str(ran.exception)
    assert (ran.exit_code, code) == (0, 0)
    return ran.stdout, ""


def test_a_script_has_to_say_yes(url: str, tmp_path: Path) -> None:
    keep(url, heron=tmp_path / "a.mcap")
    _, why = erase(url, "--recordings", code=1)
    assert why == "erasing heron cannot be undone, and nobody is here to be asked: --yes goes on"
    assert left(url) == ["heron a.mcap"]
    assert (tmp_path / "a.mcap").exists()
    said, _ = erase(url, "--recordings", "--yes")
    assert said == f"heron: 1 attempt erased\nerased: {tmp_path / 'a.mcap'}\n"
    assert not (tmp_path / "a.mcap").exists()
    assert left(url) == []
    with Store(url) as store, pytest.raises(StoreError, match="there is no trainee 'heron'"):
        store.erase("heron")


def at_a_terminal(url: str, answer: bytes, *options: str) -> tuple[int, str]:
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "trocar.services.cli.app", "attempts", "erase", "heron", "--database", url]
    process = subprocess.Popen([*command, *options], stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    os.close(theirs)
    os.write(ours, answer)
    said, _ = process.communicate(timeout=PATIENCE_S)
    os.close(ours)
    return process.returncode, said.decode()


def test_a_person_is_asked_and_told_what_goes(tmp_path: Path) -> None:
    url = str(tmp_path / "a.sqlite")
    mine, shared, moved = (tmp_path / name for name in ("mine.mcap", "shared.mcap", "moved.mcap"))
    keep(url, heron1=mine, heron2=shared, wren=shared, heron3=moved)
    moved.unlink()
    code, said = at_a_terminal(url, b"n\n", "--recordings")
    assert code == 1
    assert "heron: 3 attempts" in said
    assert f"will be removed: {mine}" in said
    assert f"stays whole, as it also holds attempts of wren: {shared}" in said
    assert f"is not there any more, moved or removed before: {moved}" in said
    assert len(left(url)) == 4
    assert mine.exists()
    assert at_a_terminal(url, b"y\n", "--recordings")[0] == 0
    assert left(url) == ["wren shared.mcap"]
    assert (mine.exists(), shared.exists()) == (False, True)


def test_a_recording_that_is_shared_stays_and_a_moved_one_is_told(url: str, tmp_path: Path) -> None:
    mine, shared, moved = (tmp_path / name for name in ("mine.mcap", "shared.mcap", "moved.mcap"))
    keep(url, heron1=mine, heron2=shared, wren=shared, magpie=shared, heron3=moved)
    moved.rename(tmp_path / "elsewhere.mcap")
    told = json.loads(erase(url, "--recordings", "--yes", "--json")[0])
    assert told == {
        "erased": "heron", "attempts": 3, "left": 0, "recordings": [str(mine)], "recordings_erased": True,
        "shared": {str(shared): ["magpie", "wren"]}, "missing": [str(moved)], "failed": {},
    }  # fmt: skip
    assert sorted(left(url)) == ["magpie shared.mcap", "wren shared.mcap"]
    assert shared.read_bytes() == RECORDING


def cannot_be_changed(path: Path) -> Callable[[], object]:
    chattr = shutil.which("chattr")
    if chattr is None or subprocess.run([chattr, "+i", path], capture_output=True, check=False).returncode:
        pytest.skip("no file can be made unchangeable here (chattr +i)")
    return lambda: subprocess.run(["chattr", "-i", path], check=True)


def folder_in_its_place(path: Path) -> Callable[[], object]:
    path.unlink()
    path.mkdir()
    return path.rmdir


def link_in_its_place(path: Path) -> Callable[[], object]:
    path.rename(path.with_name("moved.mcap"))
    path.symlink_to("moved.mcap")
    return path.unlink


def other_file_in_its_place(path: Path) -> Callable[[], object]:
    path.write_text("root:x:0:0")
    return path.unlink


def pipe_in_its_place(path: Path) -> Callable[[], object]:
    path.unlink()
    os.mkfifo(path)
    return path.unlink


@pytest.mark.parametrize(
    ("hinder", "why"),
    [
        (cannot_be_changed, "operation not permitted"),
        (folder_in_its_place, "a folder is in its place"),
        (link_in_its_place, "a link to moved.mcap is in its place"),
        (other_file_in_its_place, "something that is no recording is in its place"),
        (pipe_in_its_place, "something that is no recording is in its place"),
    ],
)
def test_what_cannot_be_removed_keeps_its_row_and_a_second_try_takes_both(
    url: str, tmp_path: Path, hinder: Callable[[Path], Callable[[], object]], why: str
) -> None:
    stuck, free = tmp_path / "stuck.mcap", tmp_path / "free.mcap"
    keep(url, heron1=stuck, heron2=free, wren=tmp_path / "other.mcap")
    let_go = hinder(stuck)
    try:
        said, complaint = erase(url, "--recordings", "--yes", code=1)
        assert "heron: 1 attempt erased" in said
        assert f"1 attempt of heron stay, as recordings could not be removed: {stuck}: {why};" in complaint
        assert sorted(left(url)) == ["heron stuck.mcap", "wren other.mcap"]
        assert (os.path.lexists(stuck), free.exists()) == (True, False)
    finally:
        let_go()
    erase(url, "--recordings", "--yes")
    assert left(url) == ["wren other.mcap"]
    assert not os.path.lexists(stuck)


def test_a_recording_with_another_name_is_told(url: str, tmp_path: Path) -> None:
    keep(url, heron=tmp_path / "a.mcap")
    (tmp_path / "b.mcap").hardlink_to(tmp_path / "a.mcap")
    said, _ = erase(url, "--recordings", "--yes")
    assert "1 other name (hard links) of it stay" in said


def test_a_name_that_is_no_utf8_is_erased_as_well(url: str, tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff\xfe of 100% \xc3\xbc.mcap"))
    keep(url, heron=path)
    with Store(url) as store:
        assert list(store.erase_with_recordings("heron").removed) == [path]
    assert not path.exists()
    assert left(url) == []


def test_without_recordings_only_rows_go(url: str, tmp_path: Path) -> None:
    keep(url, heron1=tmp_path / "a.mcap", heron2=tmp_path / "b.mcap")
    (tmp_path / "b.mcap").unlink()
    said, _ = erase(url, "--yes")
    assert said == f"heron: erased\nstill there: {tmp_path / 'a.mcap'}\n"
    assert left(url) == []


_FILL = """
import os, sys
from pathlib import Path
from tests.review.benches import made_up
from trocar.review.attempts.store.attempts import Store

folder = Path(sys.argv[1])
url = str(folder / "a.sqlite")
with Store(url) as store:
    for k in range(20):
        store.add(made_up(f"{k}"), "heron", folder / f"{k}.mcap")
        store.add(made_up(f"w{k}"), "wren", folder / "w.mcap")
        (folder / f"{k}.mcap").write_bytes(b"\\x89MCAP0\\r\\n")
with (folder / "fill").open("wb", buffering=0) as file:
    try:
        while True:
            file.write(b"x" * 512)
    except OSError:
        pass
assert os.statvfs(folder).f_bavail == 0
with Store(url) as store:
    assert len(store.listed("heron")) == 20, "it can be read"
    WAY
    assert [row.trainee for row in store.listed()] == ["wren"] * 20
    with store._engine.connect() as connection:
        assert connection.exec_driver_sql("PRAGMA integrity_check").scalar() == "ok"
    assert not (folder / "0.mcap").exists() or "recordings" not in "WAY"
assert b"heron" not in Path(url).read_bytes()
print("erased")
"""


@pytest.mark.parametrize("way", ["store.erase('heron')", "assert store.erase_with_recordings('heron').attempts == 20"])
def test_a_trainee_is_erased_on_a_full_disk(tmp_path: Path, way: str) -> None:
    if shutil.which("unshare") is None or subprocess.run(["unshare", "-m", "true"], check=False).returncode:
        pytest.skip("no disk of our own can be mounted here")
    mount = 'mount -t tmpfs -o size=600k tmpfs "$1" && exec "$2" -c "$3" "$1"'
    command = ["unshare", "-m", "sh", "-c", mount, "sh", tmp_path, sys.executable, _FILL.replace("WAY", way)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2])
    assert ran.stdout == "erased\n", ran.stderr
