"""The bus refuses floods by the real clock; a test whose clock runs faster than that looks like one."""

from __future__ import annotations

import signal
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.supervisor.fakes import Fakes
from trocar.services.runtime.bus import bus
from trocar.services.runtime.process.process import Options
from trocar.services.supervisor import session
from trocar.services.supervisor.control import supervisor
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew import restart_policy
from trocar.services.supervisor.crew.fork_link import ForkServer
from trocar.services.supervisor.page.page_place import PageFile, page_file, write_page_file


@pytest.fixture(autouse=True)
def faster_than_real(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus, "FLOOD_FACTOR", 1e6)


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a rig settle, and start its page again, without the second or two that it takes for either."""
    monkeypatch.setattr(supervisor, "SETTLE_S", 0.2)
    monkeypatch.setattr(restart_policy, "HELPER_BACKOFF_S", (0.2,))


class _NoPage:
    """In the place of a page's process, whose address is taken as it takes it."""

    def __init__(self, sock: socket.socket, supervisor: Supervisor, content: PageFile, *_: object) -> None:
        self._socket = sock
        write_page_file(page_file(supervisor.rig.transport), content)  # for the school

    def run_turn(self, now_s: float) -> None:
        """Tell nobody."""

    def end(self) -> None:
        """Nothing is to end."""

    def close(self) -> None:
        """Release the address."""
        self._socket.close()


@pytest.fixture
def pageless(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let rigs start no page, which takes as much processor as all their fakes: it is asked of in other tests."""
    monkeypatch.setattr(session, "Page", _NoPage)


@pytest.fixture
def fakes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fakes]:
    folder = tmp_path_factory.mktemp("rig")
    file = folder / "fakes.yaml"
    file.write_text(
        f"name: fakes\ntransport: {{directory: {folder}}}\n"
        "supervisor: {web: {port: 0}, max_restarts_per_minute: 2}\n"
    )
    kept = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}
    yield Fakes(Options(str(file), None, ()))
    for number, handler in kept.items():
        signal.signal(number, handler)


class OneServer(ForkServer):
    """A fork server that serves rig after rig: their processes import nothing anew."""

    def close(self) -> None:
        """Go on: a rig that runs, or has ended, needs it no more, the next one does."""

    def end(self) -> None:
        super().close()


@pytest.fixture(scope="module")
def server(own_cache: Path) -> Iterator[OneServer]:
    made = OneServer()
    yield made
    made.end()
