"""The process that reads foreign files: whatever a reader does, who asked goes on and has one sentence."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from trocar.services.foreign_files import Limits, Refusal, ask, ask_once, client, limits_of

ME = "tests.foreign_files.badly_behaved"
LIMITS = Limits(memory_bytes=200 << 20, cpu_s=1.0, wait_s=20.0, answer_bytes=20 << 20)
FILE = Path("x.stl")


@pytest.fixture(autouse=True)
def ended() -> Iterator[None]:
    yield
    client.close_all()


def test_messages_of_any_size_come_as_they_were_sent() -> None:
    sizes = [0, 1, 65_535, 65_536, 65_537, 3_000_000]
    assert [len(each) for each in ask(ME, "sized", FILE, LIMITS, sizes=sizes)] == sizes


@pytest.mark.parametrize(
    ("function", "kind", "sentence"),
    [
        ("takes_memory", "limit", "x.stl: takes more than 200 MiB of memory to read"),
        ("computes", "limit", "x.stl: takes more than 1 s to read"),
        ("sends_without_end", "limit", "x.stl: holds more than 20 MiB to hand on"),
        ("crashes", "crash", "x.stl: is broken: what reads such files ended on it (SIGSEGV)"),
        ("aborts", "crash", "x.stl: is broken: what reads such files ended on it (SIGABRT)"),
        ("leaves", "crash", "x.stl: is broken: what reads such files ended on it (exit code 3)"),
        ("raises", "ArithmeticError", "x.stl: cannot be read (ArithmeticError: two lines)"),
        ("tells", "Told", "x.stl: is told"),
    ],
)
def test_whatever_a_reader_does_is_one_sentence(
    function: str, kind: str, sentence: str, capfd: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):
        with pytest.raises(Refusal) as told:
            ask_once(ME, function, FILE, LIMITS)
        assert (told.value.kind, str(told.value)) == (kind, sentence)
    assert capfd.readouterr() == ("", "")


def test_a_reader_that_waits_for_ever_is_not_waited_for() -> None:
    limits = Limits(200 << 20, 1.0, 0.5, 1 << 20)
    ask_once(ME, "sized", FILE, LIMITS, sizes=[1])
    answer = ask(ME, "says_who_it_is_and_sleeps", FILE, limits)
    reader = int(next(answer))
    with pytest.raises(Refusal, match=r"x\.stl: takes more than 1 s to read"):
        next(answer)
    _wait_for_end(reader)


def test_a_reader_that_nobody_listens_to_any_more_is_ended() -> None:
    answer = ask(ME, "says_who_it_is_and_sleeps", FILE, LIMITS)
    reader = int(next(answer))
    answer.close()
    _wait_for_end(reader)


def _wait_for_end(pid: int) -> None:
    give_up_s = time.monotonic() + 30.0
    while Path(f"/proc/{pid}").exists():
        assert time.monotonic() < give_up_s, "it still runs"
        time.sleep(0.01)


def test_answers_that_are_read_in_turns_do_not_wait_for_each_other() -> None:
    """A reader that has sent all of a long answer ends while nobody takes it; the next one is asked all the same."""
    first = ask(ME, "sized", FILE, LIMITS, sizes=[1, 150_000])
    next(first)
    time.sleep(0.2)
    for _ in range(3):
        assert len(ask_once(ME, "sized", FILE, LIMITS, sizes=[2, 3])) == 2
    assert [len(each) for each in first] == [150_000]


def test_a_fork_of_who_asked_asks_a_server_of_its_own() -> None:
    ask_once(ME, "sized", FILE, LIMITS, sizes=[1])
    pid = os.fork()
    if pid == 0:
        try:
            code = len(ask_once(ME, "sized", FILE, LIMITS, sizes=[1, 2]))
            client.close_all()
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 2
    assert len(ask_once(ME, "sized", FILE, LIMITS, sizes=[1])) == 1


def test_the_limits_follow_the_bytes_on_the_disk_and_not_the_length(tmp_path: Path) -> None:
    sparse, full = tmp_path / "sparse", tmp_path / "full"
    with sparse.open("wb") as file:
        file.truncate(10 << 30)
    full.write_bytes(bytes(range(256)) * 4096)
    assert limits_of(sparse) == limits_of(tmp_path / "none")
    assert limits_of(full).memory_bytes - limits_of(sparse).memory_bytes >= 20 << 20
