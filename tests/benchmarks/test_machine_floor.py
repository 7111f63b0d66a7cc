"""The watcher of the machine's floor counts late wake-ups on every core."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def machine_floor(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(sys, "path", [str(BENCHMARKS), *sys.path])
    return importlib.import_module("machine_floor")


def test_a_wake_up_that_is_over_a_millisecond_late_is_counted(
    machine_floor: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_ns, naps = [1_000_123], []

    def sleep(seconds: float) -> None:
        naps.append(seconds)
        now_ns[0] += round(seconds * 1e9) + (2_000_000 if len(naps) == 3 else 50_000)

    monkeypatch.setattr(machine_floor.time, "sleep", sleep)
    monkeypatch.setattr(machine_floor.time, "monotonic_ns", lambda: now_ns[0])
    monkeypatch.setattr(machine_floor, "pin_above_all", lambda core: True)
    monkeypatch.setattr(machine_floor.gc, "disable", lambda: None)
    found = machine_floor.watch(0, 0.0525)
    assert len(naps) == 10
    assert found["lost_percent"] == 10.0
    assert found["worst_us"] == pytest.approx(2000.0, abs=1.0)


def test_all_cores_are_watched_meanwhile(machine_floor: Any) -> None:
    with machine_floor.Floor(0.02) as floor:
        pass
    assert floor.cores[0]["core"] == min(core["core"] for core in floor.cores)
