"""The whole rig for a minute: loops, paths, answered samples, context switches, processor time, beside the floor.

    python benchmarks/bench_rig.py [--seconds 60] [--runs 5] [trocar up's options]
    python benchmarks/bench_rig.py --beside alone observers
    python benchmarks/bench_rig.py --beside alone stress --name rig-stress
    python benchmarks/bench_rig.py --beside alone door --name rig-door
    python benchmarks/bench_rig.py --beside alone xapi --name rig-xapi
    python benchmarks/bench_rig.py --beside alone page stereo --name rig-stereo

Runs ``trocar up --seconds N --json FILE`` several times and tabulates medians over the runs; the table is written anew
after each round. ``--beside`` names what runs beside it, interleaved: ``observers`` are four readers of every frame of
every topic and a fifth that never takes what it has subscribed to, ``stress`` is stress-ng (a Debian package) with two
processes that compute and two that fill memory, on whatever core they get, ``door`` is `trocar foxglove` with a viewer
that reads all channels and one that never reads, ``xapi`` sends attempts again and again to a record store that is not
there, one that never answers and one that is always busy, ``page`` is the rig's page in headless Chromium, which draws
on the same cores, and ``stereo`` is that page with a picture for each eye. Where ``alone`` is among them, the table
ends with what the others change: the median of the differences, each of two runs one after the other, beside how far
the runs alone lie apart. A bare sleeper on each core, above every process of the rig, watches in every run what the
machine takes (`machine_floor`), when nobody of the rig works: nobody's ticks can be better.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from machine_floor import Floor
from report import RESULTS, Row, end_in_good_order, write_report
from rig_threads import watch
from watched_rig import STRESS

ROOT = Path(__file__).resolve().parents[1]
LOADS = ("alone", "observers", "stress", "door", "xapi", "page", "stereo")
_OBSERVERS = ("reads",) * 4 + ("stops",)
#: Misses that are asked of a loop: so many times the floor, or this share where that is more; under stress, this share.
_TIMES_FLOOR, _LEAST_PERCENT, _STRESS_PERCENT = 2.0, 0.02, 0.2
#: Asked of each loop: the core it runs on, and its work at 50 and 99 % in us.
_LOOPS = {"gateway": (0, 55.0, 110.0), "haptics": (0, 140.0, 280.0), "physics": (1, 190.0, 380.0)}


@contextmanager
def _beside(load: str, directory: Path, address: str) -> Iterator[None]:
    page = [sys.executable, str(ROOT / "benchmarks/page_viewer.py"), address]
    commands = {
        "alone": [],
        "observers": [
            [sys.executable, str(ROOT / "benchmarks/rig_observers.py"), str(directory), k] for k in _OBSERVERS
        ],
        "stress": [STRESS],
        "door": [[sys.executable, str(ROOT / "benchmarks/door_viewers.py"), str(directory)]],
        "xapi": [[sys.executable, str(ROOT / "benchmarks/xapi_senders.py")]],
        "page": [page],
        "stereo": [[*page, "--stereo"]],
    }[load]
    started = [subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL) for command in commands]
    try:
        yield
    finally:
        for process in started:
            process.terminate()
            process.wait()


def run_rig(seconds: float, options: list[str], load: str) -> dict[str, Any]:
    """Return the report of one run, with what its threads cost and what the machine took meanwhile."""
    with tempfile.TemporaryDirectory() as folder:
        file, bus = Path(folder) / "run.json", Path(folder) / "bus"
        trocar = str(Path(sys.executable).with_name("trocar"))
        overrides = ["--set", f"transport.directory={bus}", *options]
        command = [trocar, "up", "--seconds", str(seconds), "--json", str(file), *overrides]
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}  # what it says is waited for
        process = subprocess.Popen(
            command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
        )
        try:
            said = "".join(iter(lambda: _until_running(process), None))
            with _beside(load, bus, _address_of(said)), Floor(seconds) as floor:
                threads = watch(process.pid, seconds - 2.0)
            said += process.communicate()[0]
        finally:
            process.terminate()  # where it has not ended by itself
            process.wait()
        if process.returncode != 0:
            raise SystemExit(f"trocar up ended with {process.returncode}:\n{said[-2000:]}")
        report: dict[str, Any] = json.loads(file.read_text())
    for loop in report["loops"].values():
        loop["miss_percent"] = 100.0 * loop["miss_ratio"]
    return {**report, "threads": threads, "floor": floor.cores, "load": load}


def _address_of(said: str) -> str:
    """Return the address of the page that `trocar up` has told, empty where it serves none."""
    found = re.search(r"http\S+", said)
    return found[0] if found else ""


def _until_running(process: subprocess.Popen[str]) -> str | None:
    """Return a line of what `process` says, None once it has said that the rig is running, or ended."""
    assert process.stdout is not None
    line = process.stdout.readline()
    return None if not line or "is running" in line else line


def _values(runs: list[dict[str, Any]], *keys: str | int) -> list[float]:
    values = []
    for run in runs:
        value: Any = run
        for key in keys:
            value = value[key]
        values.append(np.nan if value is None else float(value))
    return values


def _row(
    name: str, values: list[float], unit: str, limit: float | None = None, *, at_least: bool = False, **extra: float
) -> Row:
    """Return the median of `values`; noise is their range over it."""
    median = float(np.median(values))
    noise = (max(values) - min(values)) / median if median and len(values) > 1 else None
    return Row(name, median, unit, limit, noise=noise, at_least=at_least, extra={"worst": max(values), **extra})


def _latency(
    runs: list[dict[str, Any]], name: str, keys: tuple[str, ...], limits: tuple[float | None, float | None]
) -> list[Row]:
    rows = [_row(f"{name}, median", _values(runs, *keys, "p50"), "us", limits[0])]
    p99_9 = float(np.median(_values(runs, *keys, "p99_9")))
    return [*rows, _row(f"{name}, 99 %", _values(runs, *keys, "p99"), "us", limits[1], p99_9_us=p99_9)]


def _loop_rows(runs: list[dict[str, Any]], load: str) -> list[Row]:
    rows = []
    for core in (0, 1):
        late = _values(runs, "floor", core, "lost_percent")
        rows.append(_row(f"machine floor, core {core}: late wake-ups of a bare sleeper", late, "%"))
        slow = _values(runs, "floor", core, "arithmetic_us")
        swing = float(np.median(_values(runs, "floor", core, "arithmetic_p99_over_median")))
        rows.append(_row(f"machine floor, core {core}: fixed arithmetic", slow, "us", p99_over_median=swing))
    for loop, (core, p50, p99) in _LOOPS.items():
        floor = float(np.median(_values(runs, "floor", core, "lost_percent")))
        limit = _STRESS_PERCENT if load == "stress" else max(_TIMES_FLOOR * floor, _LEAST_PERCENT)
        misses = _values(runs, "loops", loop, "miss_percent")
        rows.append(_row(f"{loop}: rate", _values(runs, "loops", loop, "rate_hz"), "Hz", 999.0, at_least=True))
        rows.append(_row(f"{loop}: late or lost ticks", misses, "%", limit))
        rows += _latency(runs, f"{loop}: work", ("loops", loop, "work_us"), (p50, p99))
    return rows


def _thread_rows(runs: list[dict[str, Any]]) -> list[Row]:
    """Return who switches more than a hundred times a second, and what of a core that takes."""
    counts = [run["threads"]["threads"] for run in runs]
    medians = {
        name: [float(np.median([each[name][key] for each in counts])) for key in ("switches_per_s", "percent")]
        for name in counts[0]
        if all(name in each for each in counts)
    }
    busy = sorted((name for name, found in medians.items() if found[0] > 100.0), key=lambda name: -medians[name][0])
    return [Row(f"switches of {name}", medians[name][0], "1/s", extra={"percent": medians[name][1]}) for name in busy]


def rows_of(runs: list[dict[str, Any]], load: str) -> list[Row]:
    """Return the table of several runs under one load."""
    rows = [*_loop_rows(runs, load)]
    rows.append(_row("context switches of the rig", _values(runs, "threads", "switches_per_s"), "1/s", 12_000.0))
    realtime = _values(runs, "threads", "realtime_percent")
    rows.append(_row("real-time threads' processor time", realtime, "% of a core", 65.0))
    rows.append(_row("all threads' processor time", _values(runs, "threads", "all_percent"), "% of a core"))
    rows += _thread_rows(runs)
    rows += _latency(runs, "servo", ("paths", "servo"), (None, 100.0))
    rows += _latency(runs, "device_model", ("paths", "device_model"), (170.0, 300.0))
    rows += _latency(runs, "device_force", ("paths", "device_force"), (None, None))
    rows += _latency(runs, "device_pixel", ("paths", "device_pixel"), (None, None))
    answered = [100 * share for share in _values(runs, "answered_next_tick")]
    rows.append(_row("samples answered in the next tick", answered, "%", 99.98, at_least=True))
    frames = _values(runs, "loops", "visualization", "rate_hz")
    rows.append(_row("visualization: rate", frames, "Hz", 30.0, at_least=True))
    restarts = [float(sum(run["restarts"].values())) for run in runs]
    rows.append(_row("processes restarted", restarts, "", 0.0))
    rows.append(_row("start to RUNNING, warm cache", _values(runs, "seconds_to_running"), "s", 4.0))
    return [Row(f"{load}: {row.name}", **{k: v for k, v in vars(row).items() if k != "name"}) for row in rows]


#: What a load may not change for the three loops: name, unit, and where a run's report has it, in that unit.
_UNCHANGED = (
    *((f"{loop}: late or lost ticks", "%", ("loops", loop, "miss_percent")) for loop in _LOOPS),
    *((f"{loop}: work, median", "us", ("loops", loop, "work_us", "p50")) for loop in _LOOPS),
    *((f"{loop}: work, 99 %", "us", ("loops", loop, "work_us", "p99")) for loop in _LOOPS),
    ("servo, 99 %", "us", ("paths", "servo", "p99")),
    ("device_model, median", "us", ("paths", "device_model", "p50")),
    ("device_model, 99 %", "us", ("paths", "device_model", "p99")),
)


def change_rows(alone: list[dict[str, Any]], runs: list[dict[str, Any]], load: str) -> list[Row]:
    """Return what `load` changes: medians of the differences from the run alone before each, and as their limit how far
    the runs alone lie apart."""
    rows = []
    for name, unit, keys in _UNCHANGED:
        quiet, loaded = _values(alone, *keys), _values(runs, *keys)
        change = float(np.median(np.subtract(loaded, quiet)))
        rows.append(Row(f"what {load} change: {name}", change, unit, max(quiet) - min(quiet)))
    return rows


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--beside", nargs="+", choices=LOADS, default=["alone"])
    parser.add_argument("--name", default="rig", help="of the table in benchmarks/results")
    arguments, options = parser.parse_known_args()
    end_in_good_order()
    runs: list[dict[str, Any]] = []
    for number in range(arguments.runs):
        runs += [run_rig(arguments.seconds, options, load) for load in arguments.beside]
        _write(arguments.name, runs, f"{number + 1} runs of {arguments.seconds:g} s each")


def _write(name: str, runs: list[dict[str, Any]], what: str) -> None:
    by_load = {
        load: [run for run in runs if run["load"] == load] for load in dict.fromkeys(run["load"] for run in runs)
    }
    rows = [row for load, some in by_load.items() for row in rows_of(some, load)]
    if len(by_load.get("alone", ())) > 1:
        others = [load for load in by_load if load != "alone"]
        rows += [row for load in others for row in change_rows(by_load["alone"], by_load[load], load)]
    notes = (
        f"{what}, all processes on this machine, web view, stub "
        "devices; medians over the runs, noise is their range over the median. Of the gateway's work its part between "
        "ticks (handles, models, reports) is not counted. `device_model` is timed in one tick of 16."
    )
    write_report(name, "The rig", rows, notes)
    last = RESULTS / f"{name}-last-run.json"
    last.write_text(json.dumps(runs[-1], indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
