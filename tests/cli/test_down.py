"""``trocar down`` leaves nothing of a rig, whatever became of its supervisor."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pytest

from services.cli import down
from services.runtime.flight import FlightRing, flight_directory
from services.runtime.rig import Rig, SupervisorSettings, Transport
from services.supervisor.observers.core_sleepers import PHASES
from services.supervisor.page_place import page_file, write_page_file


@pytest.mark.parametrize("mode", ["launch", "attach"])
def test_rings_and_page_file_of_a_supervisor_that_was_killed_are_removed(
    tmp_path: Path, mode: Literal["launch", "attach"]
) -> None:
    transport = Transport(directory=tmp_path / "run")
    rig = Rig(name="gone", transport=transport, supervisor=SupervisorSettings(mode=mode))
    write_page_file(page_file(transport), "http://127.0.0.1:1", "token")
    rings = flight_directory(tmp_path / "run")
    FlightRing(1000.0).share(rings / "gateway.flight")
    FlightRing(1000.0).share(rings / "floor0.flight")
    (rings / PHASES).touch()
    assert down.end_all(rig, {}) == []
    assert not page_file(transport).exists()
    assert not rings.exists() or not list(rings.iterdir())
