"""How soon the supervisor says that a process floods the bus, and that the disk is slow; what it says of stalls.

    python benchmarks/bench_notice.py [--rounds 5]

A rig whose left hand presses on the duct. In each round gateway, haptics and physics publish everything ten times for
half a second, one after the other, and the disk holds a write of the recorder for as long (`faulty_rig.py`). Noticed is
when the supervisor's history says so, as a person at its terminal reads it: after the first frame too many could be
sent, after the write began. And each of the three stands still for 20, 100 and 400 ms: the history must say so once,
with the length. No force may step by more than the rate limit, and nobody may be restarted.
"""

from __future__ import annotations

import os
import re
import signal
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from faulty_rig import BEGAN, LASTS_S, STALLS_MS
from report import Row, end_in_good_order, parse, write_report

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the tests' rig is launched as a user would

from tests.rig.conftest import HERE, SCENE, Rig, running_rig
from tests.rig.faults import engage, force_rates_n_s, rate_limit_n_s

LOOPS = ("gateway", "haptics", "physics")
NOTICE_MS, LATEST_NOTICE_MS = 50.0, 100.0
#: The supervisor says the same again after ten seconds.
_APART_S, _PATIENCE_S = 11.0, 3.0


def said_after(rig: Rig, process: str, text: str, began: Path | None = None) -> float:
    """Let `process` misbehave; return after how many ms the history had `text`, infinity for never."""
    log = rig.directory / "log"
    known = log.stat().st_size
    if began is not None:
        began.unlink(missing_ok=True)
    began_s = time.monotonic()
    os.kill(rig.observer.pids()[process], signal.SIGUSR1)
    while time.monotonic() - began_s < _PATIENCE_S:
        time.sleep(0.001)
        with log.open("rb") as file:
            file.seek(known)
            lines = file.read().decode("utf-8", "replace").splitlines()
        if any(text in line for line in lines):
            now_s = time.monotonic()
            if began is not None:
                began_s = 1e-9 * int(began.read_text())
            return 1e3 * (now_s - began_s)
    return float("inf")


def measure(rig: Rig, rounds: int, began: Path) -> dict[str, list[float]]:
    """Return the times in ms, by what went wrong."""
    found: dict[str, list[float]] = {}
    for _ in range(rounds):
        again_s = time.monotonic() + _APART_S
        for loop in LOOPS:
            found.setdefault(f"flood by {loop}", []).append(said_after(rig, loop, f"{loop}: floods "))
            time.sleep(2.0 * LASTS_S)
            rig.observer.look()
        disk = "the disk has held a write for"
        found.setdefault("slow disk", []).append(said_after(rig, "recorder", disk, began))
        while time.monotonic() < again_s:
            time.sleep(0.1)
            rig.observer.look()
    return found


def stalls(rig: Rig, rounds: int, length: Path) -> dict[int, list[tuple[float, int]]]:
    """Return by how many percent of its length each stall was told too long, and how often it was told; by length."""
    found: dict[int, list[tuple[float, int]]] = {}
    for _ in range(rounds):
        for k, stall_ms in enumerate(STALLS_MS):
            for loop in LOOPS:
                rig.observer.until(lambda loop=loop: rig.observer.report(loop) == "ready", 60.0, f"{loop} ready")
                length.unlink(missing_ok=True)
                known = (rig.directory / "log").stat().st_size
                os.kill(rig.observer.pids()[loop], signal.SIGRTMIN + k)
                until_s = time.monotonic() + 1.5 + 1e-3 * stall_ms
                while time.monotonic() < until_s:
                    time.sleep(0.02)
                    rig.observer.look()
                if not length.exists():
                    raise SystemExit(f"{loop} was not run for {1.5 + 1e-3 * stall_ms} s: the machine is too busy")
                log = (rig.directory / "log").read_bytes()[known:].decode("utf-8", "replace")
                true_ms = 1e-6 * int(length.read_text())
                told_ms = [
                    int(ms)
                    for all_ms in re.findall(rf"{loop}: stalled for ([\d, ]+) ms", log)
                    for ms in all_ms.split(", ")
                ]
                near_ms = min(told_ms, key=lambda ms: abs(ms - true_ms), default=0)
                n_told = sum(abs(ms - true_ms) < 0.1 * true_ms for ms in told_ms)  # the machine has stalls of its own
                found.setdefault(stall_ms, []).append((100.0 * (near_ms / true_ms - 1.0), n_told))
    return found


def main() -> int:
    """Measure and write the table; return 1 where something was noticed too late or never."""
    arguments = parse(__doc__, rounds=(5, "of four faults each"))
    end_in_good_order()
    # What is written by who stands still lies in memory: a file of a busy disk held it for some ms more.
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory(dir="/dev/shm") as memory:
        began = Path(memory) / "began"
        os.environ[BEGAN] = str(began)
        overrides = [f"gateway.instruments.{i}.arm.settings.script={HERE / 'press.yaml'}" for i in (0, 1)]
        command = (str(Path(__file__).with_name("faulty_rig.py")),)
        with running_rig(Path(folder), str(SCENE), overrides, program=command) as rig:
            engage(rig)
            before = rig.observer.pids()
            found = measure(rig, arguments.rounds, began)
            told = stalls(rig, arguments.rounds, began)
            lost = sum(pid != before[name] for name, pid in rig.observer.pids().items())
            fastest_n_s = max(force_rates_n_s(rig.observer.samples))
    rows = [
        Row(f"{what}: noticed after", float(np.median(ms)), "ms", NOTICE_MS, p99=max(ms)) for what, ms in found.items()
    ]
    rows += [
        Row("the latest of all", max(map(max, found.values())), "ms", LATEST_NOTICE_MS),
        Row("fastest change of force from tick to tick", fastest_n_s, "N/s", rate_limit_n_s()),
        Row("processes restarted", lost, "", 0.0),
        *(
            Row(f"{len(each)} stalls of {ms} ms: length told off by, at worst", max(abs(e) for e, _ in each), "%", 10.0)
            for ms, each in told.items()
        ),
        *(
            Row(f"stalls of {ms} ms not told exactly once", sum(n != 1 for _, n in each), "", 0.0)
            for ms, each in told.items()
        ),
    ]
    notes = f"{arguments.rounds} rounds; times are medians and, as 99 %, the longest."
    write_report("notice", "Floods and a slow disk: how soon they are said", rows, notes)
    return 0 if all(row.passed for row in rows[len(found) :]) else 1


if __name__ == "__main__":
    sys.exit(main())
