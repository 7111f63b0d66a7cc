"""The loops of the rig on each rung of the ladder of scheduling classes: rates and misses, beside the machine's floor.

    python benchmarks/bench_ladder.py [--seconds 15] [--runs 1] [--stress]
        [--rungs fifo deadline nice plain] [-- trocar up's options]

Runs ``trocar up --viewer none --seconds N`` with only one rung to take each time (`rungs` of the rig file; "plain" has
none), one rung after the other, and again: a slow spell of the machine falls on all alike. Values are medians of the
runs, and the slowest of them stands beside them. With ``--stress`` stress-ng runs on both cores
meanwhile. The emulated drives keep the class that they are granted.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
from machine_floor import Floor
from report import Row, end_in_good_order, write_report
from watched_rig import STRESS

ROOT = Path(__file__).resolve().parents[1]
RUNGS = ("fifo", "deadline", "nice", "plain")
_LOOPS = ("gateway", "haptics", "physics")


def run_rig(rung: str, seconds: float, options: list[str]) -> dict[str, Any]:
    """Return the report of one run on one rung, and what the machine took meanwhile."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.json"
        rungs = "[]" if rung == "plain" else f"[{rung}]"
        where = [f"transport.directory={folder}/bus", f"recorder.directory={folder}/recordings", f"rungs={rungs}"]
        command = [str(Path(sys.executable).with_name("trocar")), "up", "--viewer", "none", "--seconds", str(seconds)]
        command += ["--json", str(file), *(word for each in where for word in ("--set", each)), *options]
        with Floor(seconds + 8.0) as floor:  # while it starts as well
            rig = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            try:
                said = rig.communicate()[1]
            finally:
                rig.terminate()  # which ends its processes, where this one is ended before
                rig.wait()
        if rig.returncode != 0:
            raise SystemExit(f"trocar up ended with {rig.returncode}:\n{said[-2000:]}")
        report = {**json.loads(file.read_text()), "floor": floor.cores}
        rates = {loop: round(report["loops"][loop]["rate_hz"] or 0.0, 1) for loop in _LOOPS}
        print(f"{rung}: {rates} Hz", file=sys.stderr, flush=True)
        return report


@contextmanager
def stress() -> Iterator[None]:
    """Keep both cores busy, and the memory."""
    process = subprocess.Popen(STRESS, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        process.wait()


def main() -> None:
    """Run, print, write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--rungs", nargs="+", choices=RUNGS, default=RUNGS)
    parser.add_argument("--stress", action="store_true", help="stress-ng on both cores beside it (a Debian package)")
    parser.add_argument("--name", default="ladder", help="of the table in benchmarks/results")
    arguments, options = parser.parse_known_args()
    end_in_good_order()
    options = [option for option in options if option != "--"]
    rows: list[Row] = []
    runs: dict[str, list[dict[str, Any]]] = {rung: [] for rung in arguments.rungs}
    with stress() if arguments.stress else nullcontext():
        for _ in range(arguments.runs):
            for rung in arguments.rungs:
                runs[rung].append(run_rig(rung, arguments.seconds, options))
    for rung, reports in runs.items():
        had = {fact["had"] for fact in reports[0]["realtime"]["physics"] if fact["name"] == "scheduling"}
        for loop in _LOOPS:
            loops = [report["loops"][loop] for report in reports]
            rate, missed = (float(np.median([each[key] or 0.0 for each in loops])) for key in ("rate_hz", "miss_ratio"))
            late_us = float(np.median([each["lateness_us"]["p99"] for each in loops]))
            slowest_hz = min(each["rate_hz"] or 0.0 for each in loops)
            latest_ms = max(each["lateness_us"]["max"] for each in loops) / 1e3
            note = f"slowest {slowest_hz:.1f}; missed {100 * missed:.2f} %; late p99 {late_us:.0f} us"
            note += f"; latest tick {latest_ms:.0f} ms"
            name = f"{rung} ({', '.join(had)}): {loop}" if loop == "physics" else f"{rung}: {loop}"
            rows.append(Row(name, round(rate, 1), "Hz", note=note))
            print(rows[-1], flush=True)
        lost = max(core["lost_percent"] for report in reports for core in report["floor"])
        rows.append(Row(f"{rung}: the machine's own late wake-ups, worse core", round(lost, 2), "%"))
    write_report(arguments.name, "The rig on each rung of the ladder of scheduling classes", rows)


if __name__ == "__main__":
    main()
