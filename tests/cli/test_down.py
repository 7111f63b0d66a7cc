"""``trocar down`` leaves nothing of a rig, whatever became of its supervisor."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

import pytest

from trocar.services.cli import down
from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.config.rig import Rig, SupervisorSettings, Transport
from trocar.services.runtime.errors import UserError
from trocar.services.runtime.measures.flight import FlightRing, flight_directory
from trocar.services.supervisor.page.page_place import PageFile, page_file, write_page_file

OF_A_RUN = PageFile(address="http://127.0.0.1:1", token="token", rig="{}", scene="default")


@pytest.mark.parametrize("mode", ["launch", "attach"])
def test_rings_and_page_file_of_a_supervisor_that_was_killed_are_removed(
    tmp_path: Path, mode: Literal["launch", "attach"]
) -> None:
    transport = Transport(directory=tmp_path / "run")
    rig = Rig(name="gone", transport=transport, supervisor=SupervisorSettings(mode=mode))
    write_page_file(page_file(transport), OF_A_RUN)
    rings = flight_directory(tmp_path / "run")
    FlightRing(1000.0).share(rings / "gateway.flight")
    FlightRing(1000.0).share(rings / "floor0.flight")
    assert down.end_all(rig, {}) == []
    assert not page_file(transport).exists()
    assert not rings.exists() or not list(rings.iterdir())


def test_sockets_and_locks_of_processes_that_were_killed_are_removed_and_nothing_else(tmp_path: Path) -> None:
    transport = Transport(directory=tmp_path / "run")
    endpoints.claim(transport, "gateway.state").close()
    for name in ("supervisor.control", "gateway.stop", "gateway.state.ipc", "gateway.state.whole.ipc", "not.ours"):
        (tmp_path / "run" / name).touch()
    down.end_all(Rig(name="gone", transport=transport), {})
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["not.ours"]


@pytest.mark.parametrize("says_who", [True, False])
def test_files_of_a_rig_that_is_alive_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, says_who: bool) -> None:
    monkeypatch.setattr(down, "END_S", 0.1)
    monkeypatch.setattr(down, "_end", lambda *_: None)  # as if the process could not be ended
    transport = Transport(directory=tmp_path / "run")
    write_page_file(page_file(transport), OF_A_RUN)
    with endpoints.claim(transport, "gateway.state") as lock:
        if not says_who:
            lock.truncate(0)
        with pytest.raises(UserError, match=f"process {os.getpid()}" if says_who else "process unknown"):
            down.end_all(Rig(name="alive", transport=transport), {})
        assert {path.name for path in (tmp_path / "run").iterdir()} == {"page.json", "gateway.state.lock"}
