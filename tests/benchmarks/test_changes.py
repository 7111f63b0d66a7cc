"""What a load changes is told beside how far runs without it lie apart."""

from __future__ import annotations

import copy
import importlib
import sys
from pathlib import Path
from typing import Any

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


def _run(scale: float) -> dict[str, Any]:
    each = {"miss_percent": 0.1 * scale, "work_us": {"p50": 100.0 * scale, "p99": 200.0 * scale}}
    path = {"p50": 100.0 * scale, "p99": 200.0 * scale}
    loops = {name: copy.deepcopy(each) for name in ("gateway", "haptics", "physics")}
    return {"loops": loops, "paths": {"servo": path, "device_model": path}}


@pytest.mark.parametrize(("more", "within"), [(0.5, True), (3.0, False)])
def test_a_change_is_judged_by_how_far_runs_alone_lie_apart(
    more: float, within: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", [str(BENCHMARKS), *sys.path])
    bench_rig = importlib.import_module("bench_rig")
    alone = [_run(scale) for scale in (1.0, 2.0, 1.5)]
    beside = [_run(scale + more) for scale in (1.0, 2.0, 1.5)]
    rows = bench_rig.change_rows(alone, beside, "observers")
    work = next(row for row in rows if row.name == "what observers change: physics: work, 99 %")
    assert work.value == pytest.approx(200.0 * more)
    assert work.limit == pytest.approx(200.0)
    assert all(row.passed is within for row in rows)
