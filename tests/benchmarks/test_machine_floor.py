"""The watcher of the machine's floor wakes when nobody of a rig works, where the rig says when that is."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from trocar.services.runtime.private_directory import make_private
from trocar.services.supervisor.diagnosis.core_sleepers import PERIOD_NS, PHASES, Phases

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def machine_floor(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(sys, "path", [str(BENCHMARKS), *sys.path])
    return importlib.import_module("machine_floor")


@pytest.mark.parametrize("phase_ns", [0, 1, 420_000, PERIOD_NS - 1])
@pytest.mark.parametrize("now_ns", [0, 7, 123_456_789_012, 5 * PERIOD_NS])
def test_it_moves_to_the_next_quiet_moment(machine_floor: Any, phase_ns: int, now_ns: int) -> None:
    found_ns = machine_floor.next_at(phase_ns, now_ns)
    assert found_ns % PERIOD_NS == phase_ns
    assert 0 <= found_ns - now_ns < PERIOD_NS


def test_it_sleeps_to_that_moment(machine_floor: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What it asks the clock to sleep for ends at the phase of its core, on the grid of its own period."""
    phases = Phases(make_private(tmp_path / "rings") / PHASES, create=True)
    phases[0] = 420_000
    now_ns, ends_ns = [1_000_123], []

    def sleep(seconds: float) -> None:
        now_ns[0] += round(seconds * 1e9)
        ends_ns.append(now_ns[0])

    monkeypatch.setattr(machine_floor.time, "sleep", sleep)
    monkeypatch.setattr(machine_floor.time, "monotonic_ns", lambda: now_ns[0])
    monkeypatch.setattr(machine_floor, "pin_above_all", lambda core: True)
    monkeypatch.setattr(machine_floor.gc, "disable", lambda: None)
    machine_floor.watch(0, 0.05, phases)
    assert len(ends_ns) == 10
    assert {end % PERIOD_NS for end in ends_ns} == {420_000}


def test_it_watches_beside_a_rig_that_says_nothing(machine_floor: Any, tmp_path: Path) -> None:
    with machine_floor.Floor(0.02, tmp_path / "no such directory") as floor:
        pass
    assert floor.cores[0]["core"] == min(core["core"] for core in floor.cores)


def test_its_command_takes_the_file(tmp_path: Path) -> None:
    Phases(make_private(tmp_path / "rings") / PHASES, create=True)[0] = 1000
    command = [sys.executable, str(BENCHMARKS / "machine_floor.py"), "0", "0.02", str(tmp_path / "rings" / PHASES)]
    found = subprocess.run(command, capture_output=True, text=True, check=True, cwd=BENCHMARKS.parent)
    assert json.loads(found.stdout)["core"] == 0
