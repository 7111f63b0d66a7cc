"""Nobody else gets in: the rig's directory is this user's alone, whoever was there first."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from tests.other_user import as_other_user, everybodys, needs_other_user
from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.config.rig import Transport
from trocar.services.runtime.errors import BusError
from trocar.services.runtime.private_directory import open_private, open_text
from trocar.services.supervisor.page.page_place import PageFile, page_file, write_page_file

__all__ = ["everybodys"]

OF_A_RUN = PageFile(address="http://127.0.0.1:1/", token="token", rig="{}", scene="default")


def test_it_is_made_for_this_user_alone(tmp_path: Path) -> None:
    made = endpoints.run_directory(Transport(directory=tmp_path / "a" / "rig"))
    assert made.stat().st_mode & 0o7777 == 0o700
    assert made.parent.stat().st_mode & 0o7777 == 0o700


def test_the_session_of_the_user_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert endpoints.run_directory(Transport()) == tmp_path / f"trocar-{os.getuid()}"


@pytest.mark.parametrize("none", ["", "runtime", "./runtime"])
def test_a_place_that_each_folder_has_another_of_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, none: str
) -> None:
    """As the XDG Base Directory Specification has it: `trocar diagnose top` in another folder would find no rig."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", none)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(endpoints, "make_private", lambda path: path)
    assert endpoints.run_directory(Transport()) == Path("/tmp") / f"trocar-{os.getuid()}"


@pytest.mark.parametrize("mode", [0o755, 0o770, 0o702])
def test_one_that_is_open_to_others_is_refused(tmp_path: Path, mode: int) -> None:
    (tmp_path / "rig").mkdir()
    (tmp_path / "rig").chmod(mode)
    with pytest.raises(BusError, match=rf"others may use it \(mode {mode:04o}, must be 0700\)"):
        endpoints.run_directory(Transport(directory=tmp_path / "rig"))


@pytest.mark.parametrize(
    "place", ["/etc/passwd", "/etc", "/", "/dev/null", "{here}/file", "{here}/link", "{here}/open"]
)
def test_nobody_is_told_to_take_away_what_is_in_its_place(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to("/etc/passwd")
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o755)
    with pytest.raises(BusError, match=r"name another as transport\.directory") as caught:
        endpoints.run_directory(Transport(directory=Path(place.format(here=tmp_path))))
    assert not re.search(r"remove|delete|\brm\b", str(caught.value))


def test_a_link_is_refused_even_to_a_directory_of_ours(tmp_path: Path) -> None:
    (tmp_path / "ours").mkdir(mode=0o700)
    (tmp_path / "rig").symlink_to(tmp_path / "ours")
    with pytest.raises(BusError, match="is a link or no directory"):
        endpoints.run_directory(Transport(directory=tmp_path / "rig"))


def test_a_folder_in_which_everybody_may_rename_is_refused(tmp_path: Path) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    with pytest.raises(BusError, match="others may write to"):
        endpoints.run_directory(Transport(directory=tmp_path / "open" / "rig"))


def test_a_file_is_never_opened_through_a_link(tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.write_text("mine")
    directory = endpoints.run_directory(Transport(directory=tmp_path / "rig"))
    for name in ("page.json", "gateway.state.lock", "physics.log"):
        (directory / name).symlink_to(precious)
        with pytest.raises(BusError, match="is not a file of ours"):
            open_private(directory / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    with pytest.raises(BusError, match="is not a file of ours"):
        endpoints.claim(Transport(directory=directory), "gateway.state")
    assert precious.read_text() == "mine"


@pytest.mark.parametrize("flags", [os.O_RDONLY, os.O_RDWR | os.O_CREAT, os.O_WRONLY | os.O_CREAT])
def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path, flags: int) -> None:
    directory = endpoints.run_directory(Transport(directory=tmp_path / "rig"))
    os.mkfifo(directory / "gateway.state.lock")
    with pytest.raises(BusError, match=r"gateway\.state\.lock: is not a file of ours"):
        open_private(directory / "gateway.state.lock", flags)


_SQUAT = """
import os, sys
directory, target = sys.argv[1:]
os.mkdir(directory, 0o700)
os.symlink(target, directory + "/page.json")
os.chmod(directory, 0o777)
"""


@needs_other_user
def test_another_user_who_was_there_first_receives_nothing(everybodys: Path, tmp_path: Path) -> None:
    """The attack: make the directory before the victim does, and have the victim write its token where one likes."""
    precious = tmp_path / "precious"
    precious.write_text("mine")
    transport = Transport(directory=everybodys / f"trocar-{os.getuid()}")
    assert as_other_user(_SQUAT, transport.directory, precious).returncode == 0  # type: ignore[arg-type]
    with pytest.raises(BusError, match="it belongs to user 65534"):
        write_page_file(page_file(transport), OF_A_RUN)
    assert precious.read_text() == "mine"


@needs_other_user
def test_a_folder_of_another_user_is_not_trusted_with_ours(everybodys: Path) -> None:
    assert as_other_user("import os, sys; os.mkdir(sys.argv[1])", everybodys / "theirs").returncode == 0
    with pytest.raises(BusError, match="theirs belongs to user 65534"):
        endpoints.run_directory(Transport(directory=everybodys / "theirs" / "rig"))


_PRY = """
import socket, sys
directory = sys.argv[1]
for attempt in (
    lambda: open(directory + "/page.json").read(),
    lambda: open(directory + "/gateway.state.lock").read(),
    lambda: socket.socket(socket.AF_UNIX).connect(directory + "/gateway.state.ipc"),
):
    try:
        attempt()
    except PermissionError:
        continue
    sys.exit("got in")
"""


@needs_other_user
def test_another_user_reads_neither_token_nor_frames(everybodys: Path) -> None:
    transport = Transport(directory=everybodys / "rig")
    write_page_file(page_file(transport), OF_A_RUN)
    with endpoints.claim(transport, "gateway.state"):
        done = as_other_user(_PRY, endpoints.run_directory(transport))
    assert (done.returncode, done.stderr) == (0, "")


def test_what_is_written_is_for_this_user_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        with open_text(tmp_path / "page.json", os.O_WRONLY | os.O_CREAT) as file:
            assert os.fstat(file.fileno()).st_mode & 0o777 == 0o600
    finally:
        os.umask(before)


def test_sockets_of_the_dead_are_removed_those_of_the_living_stay(tmp_path: Path) -> None:
    transport = Transport(directory=tmp_path / "rig")
    directory = endpoints.run_directory(transport)
    names = ["gateway.state.ipc", "gateway.state.whole.ipc", "physics.state.ipc", "physics.state.whole.ipc"]
    for name in names:
        (directory / name).touch()
    with endpoints.claim(transport, "physics.state"):
        assert endpoints.remove_stale(transport) == names[:2]
        assert sorted(path.name for path in directory.glob("*.ipc")) == names[2:]
    assert endpoints.remove_stale(transport) == names[2:]
