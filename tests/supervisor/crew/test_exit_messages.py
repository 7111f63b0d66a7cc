"""What a person is told of a process that ended while it started."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from trocar.services.supervisor.crew.exit_messages import start_sentence
from trocar.services.supervisor.crew.launcher import Child
from trocar.services.supervisor.crew.member import Member
from trocar.services.supervisor.crew.processes import ProcessSpec

LOG = Path("picture.log")
SENTENCE = "visualization: visualization.viewer: no window on display :97 within 30 s"


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ([SENTENCE], SENTENCE),
        ([SENTENCE, "OpenGLRenderWindow: bad X server connection"], SENTENCE),
        (["visualization: INFO view on ws://x", "driver: out of memory"], "driver: out of memory"),
        (["Traceback (most recent call last):", SENTENCE, "KeyError: 3"], "KeyError: 3"),
        ([], "it said nothing"),
    ],
)
def test_its_own_sentence_is_told_whatever_a_library_says_after_it(lines: list[str], told: str) -> None:
    member = cast(Member, SimpleNamespace(name="visualization", last_lines=lines))
    sentence = start_sentence(member, 4, LOG)
    own = told == SENTENCE
    assert sentence == (told if own else f"visualization ended with exit code 4 while starting: {told} (see {LOG})")


def test_colours_of_a_library_are_not_repeated(tmp_path: Path) -> None:
    tmp_path.chmod(0o700)
    says = ["-n1", "-r1", r"print('\33[0m\33[33mbad server\33[0m')"]
    child = Child(ProcessSpec("timer", "timeit"), says, tmp_path / "log")
    while child.wait(1.0) is None:
        pass
    lines = child.lines()
    child.close()
    assert lines[0] == "bad server"


def test_who_had_no_room_for_a_word_is_told_by_the_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    member = cast(Member, SimpleNamespace(name="gateway", last_lines=[]))
    asked: list[Path] = []

    def full(directory: Path) -> SimpleNamespace:
        asked.append(directory)
        return SimpleNamespace(f_bavail=14, f_frsize=4096)

    monkeypatch.setattr("os.statvfs", full)
    sentence = start_sentence(member, 1, tmp_path / "gateway.log")
    assert f"while starting: it said nothing, and {tmp_path} has 56 kB left (see " in sentence
    assert asked == [tmp_path]
