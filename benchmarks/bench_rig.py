"""The whole rig for a minute: loops, paths, answered samples.

``python benchmarks/bench_rig.py [--seconds 60] [--runs 3]`` runs `trocar up --seconds N --json FILE` several times and
tabulates medians over the runs, with the machine's own stalls beside them: a thread that only sleeps and looks at the
clock, in the ordinary class, while nothing of the rig runs.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
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


def machine_stalls(seconds: float) -> np.ndarray:
    """Return the lateness, in us, of 1 ms sleeps of this process alone."""
    late = []
    end = time.monotonic_ns() + round(seconds * 1e9)
    due = time.monotonic_ns()
    while due < end:
        due += 1_000_000
        time.sleep(max(0, due - time.monotonic_ns()) * 1e-9)
        late.append((time.monotonic_ns() - due) / 1e3)
        due = max(due, time.monotonic_ns())
    return np.array(late)


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
    before = machine_stalls(5.0)
    runs = [run_rig(arguments.seconds, options) for _ in range(arguments.runs)]
    after = machine_stalls(5.0)
    stalls = np.concatenate([before, after])
    notes = (
        f"{arguments.runs} runs of {arguments.seconds:g} s, all processes on this machine, web view, stub devices; "
        f"medians over the runs. The machine alone, a sleeping thread before and after: "
        f"median {np.median(stalls):.0f} us late, "
        f"99 % {np.percentile(stalls, 99):.0f} us, worst {stalls.max():.0f} us of {len(stalls)} sleeps."
    )
    write_report("rig", "The rig", rows_of(runs), notes)
    (RESULTS / "rig-last-run.json").write_text(json.dumps(runs[-1], indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
