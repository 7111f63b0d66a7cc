"""A process of a rig is known on its host from its start, before it publishes anything."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.errors import BusError, ConfigError
from trocar.services.runtime.process.process import ProcessConfig, main


@pytest.fixture(autouse=True)
def signals() -> Iterator[None]:
    """Put back what a process does with signals."""
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in kept.items():
        signal.signal(number, handler)


def _start(directory: Path, prepare: Callable[[ProcessConfig], None], *words: str) -> int:
    def run(*_: object) -> None:
        raise AssertionError("it is not to run")

    return main("recorder", run, ["--set", f"transport.directory={directory}", *words], prepare=prepare)


@pytest.mark.parametrize("word", ["", "--prepare-only"])
def test_who_still_prepares_holds_its_lock_unless_it_is_of_no_rig(tmp_path: Path, word: str) -> None:
    """`trocar down` removed the files of a rig whose physics was still compiling, and let it go on."""
    found: list[dict[str, int]] = []

    def prepare(process: ProcessConfig) -> None:
        found.append(endpoints.lock_holders(process.rig.transport))
        raise ConfigError("enough")

    assert _start(tmp_path / "run", prepare, *filter(None, [word])) == ConfigError.exit_code
    assert found == [{} if word else {"recorder": os.getpid()}]


def test_a_second_process_of_a_name_says_who_is_the_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def prepare(process: ProcessConfig) -> None:
        assert _start(tmp_path / "run", lambda _: None) == BusError.exit_code
        raise ConfigError("enough")

    assert _start(tmp_path / "run", prepare) == ConfigError.exit_code
    assert f"recorder: recorder is already run by process {os.getpid()} (lock" in capsys.readouterr().err
