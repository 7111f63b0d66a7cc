"""Every test has its own bus namespace."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from trocar.services.runtime.config.rig import Transport


@pytest.fixture
def transport(tmp_path_factory: pytest.TempPathFactory) -> Transport:
    directory: Path = tmp_path_factory.mktemp("bus")
    return Transport(directory=directory)


@pytest.fixture(autouse=True)
def default_directory(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a rig without a directory of its own hold its locks where no other rig of this host does."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("runtime")))


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def eventually() -> Callable[[Callable[[], bool]], None]:
    """Wait for a condition; fails after half a minute."""

    def wait(condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline, "it did not happen"
            time.sleep(1e-3)

    return wait
