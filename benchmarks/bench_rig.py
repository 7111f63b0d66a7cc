"""The whole rig for a minute: loops, paths, answered samples.

``python benchmarks/bench_rig.py [--seconds 60] [--runs 3]`` runs `trocar up --seconds N --json FILE` several times and
tabulates medians over the runs. One run more has a watcher on each core, above every process of the rig, that does
nothing but sleep: what it loses the machine takes, and nobody's ticks can be better (`machine_floor`). That run is
not in the medians, for the watchers cost a little themselves.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from machine_floor import Floor
from report import RESULTS, Row, write_report

ROOT = Path(__file__).resolve().parents[1]


def run_rig(seconds: float, options: list[str]) -> dict[str, Any]:
    """Return the report of one run."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.json"
        command = [
            str(Path(sys.executable).with_name("trocar")),
            "up",
            "--seconds",
            str(seconds),
            "--json",
            str(file),
            *options,
        ]
        subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        report: dict[str, Any] = json.loads(file.read_text())
    return report


def floor_rows(seconds: float, options: list[str]) -> list[Row]:
    """Return what a bare sleeper loses on each core while the rig runs, and what the rig lost in the same run."""
    with Floor(seconds) as floor:
        run = run_rig(seconds, options)
    rows = [
        Row(f"machine floor, core {each['core']}: ticks lost", each["lost_percent"], "%", extra=each)
        for each in floor.cores
    ]
    for loop in ("gateway", "haptics", "physics"):
        rows.append(Row(f"{loop}: late or lost ticks in that run", 100 * run["loops"][loop]["miss_ratio"], "%"))
    return rows


def _median(runs: list[dict[str, Any]], *keys: str) -> float:
    values = []
    for run in runs:
        value: Any = run
        for key in keys:
            value = value[key]
        values.append(np.nan if value is None else float(value))
    return float(np.median(values))


def _latency(
    runs: list[dict[str, Any]], name: str, keys: tuple[str, ...], limits: tuple[float | None, float | None]
) -> list[Row]:
    p99_9 = {"p99_9_us": _median(runs, *keys, "p99_9"), "max_us": _median(runs, *keys, "max")}
    rows = [Row(f"{name}, median", _median(runs, *keys, "p50"), "us", limits[0], extra=p99_9)]
    rows.append(Row(f"{name}, 99 %", _median(runs, *keys, "p99"), "us", limits[1], extra=p99_9))
    return rows


def rows_of(runs: list[dict[str, Any]]) -> list[Row]:
    """Return the table of several runs."""
    rows = [Row("start to RUNNING, warm cache", _median(runs, "seconds_to_running"), "s", 10.0)]
    for loop, ratio in (("gateway", 0.1), ("haptics", 0.1), ("physics", 0.1), ("visualization", 1.0)):
        rate = 999.0 if loop != "visualization" else 30.0
        rows.append(Row(f"{loop}: rate", _median(runs, "loops", loop, "rate_hz"), "Hz", rate, at_least=True))
        rows.append(Row(f"{loop}: late or lost ticks", 100 * _median(runs, "loops", loop, "miss_ratio"), "%", ratio))
        rows += _latency(runs, f"{loop}: work", ("loops", loop, "work_us"), (None, None))
    rows += _latency(runs, "servo", ("paths", "servo"), (None, 100.0))
    rows += _latency(runs, "device_model", ("paths", "device_model"), (350.0, 800.0))
    rows += _latency(runs, "device_force", ("paths", "device_force"), (None, None))
    rows += _latency(runs, "device_pixel", ("paths", "device_pixel"), (None, None))
    answered = 100 * _median(runs, "answered_next_tick")
    rows.append(Row("samples answered in the next tick", answered, "%", 99.0, at_least=True))
    return rows


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--runs", type=int, default=3)
    arguments, options = parser.parse_known_args()
    runs = [run_rig(arguments.seconds, options) for _ in range(arguments.runs)]
    rows = rows_of(runs) + floor_rows(arguments.seconds, options)
    notes = (
        f"{arguments.runs} runs of {arguments.seconds:g} s, all processes on this machine, web view, stub devices; "
        "medians over the runs. The last five lines are one run more, with a bare sleeper above the rig on each core."
    )
    write_report("rig", "The rig", rows, notes)
    (RESULTS / "rig-last-run.json").write_text(json.dumps(runs[-1], indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
