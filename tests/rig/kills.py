"""Faults of a running rig by chance: ``python -m tests.rig.kills``; part of ``./dev test --long``, before a release.

Processes are killed or frozen at moments that a seed draws. A fault is mended if the process is back and the rig runs
within the patience of the tests, the force at the hand never changed faster than it may, and it came back.
"""

from __future__ import annotations

import argparse
import secrets
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from services.whole_file import whole_file

from studies.stability.report import rate
from tests.rig.conftest import HERE, SCENE, Rig, running_rig
from tests.rig.faults import FAULTS, strike

COUNT = 60
MOST_PAUSE_S = 3.0
Fault = tuple[str, signal.Signals]


def strike_by_chance(rig: Rig, seed: int, count: int) -> list[tuple[Fault, str]]:
    """Strike so many times; return each fault and, where it was not mended, why."""
    random, seen = np.random.default_rng(seed), []
    for k in range(count):
        fault = FAULTS[random.integers(len(FAULTS))]
        time.sleep(float(random.uniform(0.0, MOST_PAUSE_S)))
        try:
            strike(rig, *fault)
            why = ""
        except AssertionError as error:
            why = str(error).splitlines()[0] if str(error) else "an assertion without a word"
        seen.append((fault, why))
        print(f"{k + 1} of {count}: {fault[0]}, {fault[1].name}: {why or 'mended'}", file=sys.stderr, flush=True)
    return seen


def page(seed: int, seen: Sequence[tuple[Fault, str]]) -> str:
    """Return the table in Markdown."""
    struck, failed = Counter(fault for fault, _ in seen), Counter(fault for fault, why in seen if why)
    lines = [
        "# Faults of a running rig",
        "",
        f"Written by `python -m tests.rig.kills --seed {seed} --count {len(seen)}`; not to be edited by hand.",
        "",
        f"**{len(seen)} faults, {failed.total()} not mended**: {rate(failed.total(), len(seen))} of such faults.",
        "A process is frozen (SIGSTOP) or killed (SIGKILL) while the hand presses on the duct; it is to be noticed and",
        "started again, and the force at the hand fades and comes back no faster than it may.",
        "",
        "| process | signal | faults | not mended | rate, 95 % |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, number in FAULTS:
        n, bad = struck[name, number], failed[name, number]
        lines.append(f"| {name} | {number.name} | {n} | {bad} | {rate(bad, n)} |")
    lines += ["", *(f"- {name}, {number.name}: {why}" for (name, number), why in seen if why)]
    return "\n".join(lines).rstrip() + "\n"


def main() -> int:
    """Strike, print the table and write it where it is wanted; the exit code is 1 if a fault was not mended."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=secrets.randbelow(2**31))
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--report", type=Path)
    options = parser.parse_args()
    presses = [f"gateway.instruments.{i}.arm.settings.script={HERE / 'press.yaml'}" for i in (0, 1)]
    patient = ["supervisor.max_restarts_per_minute=1000000"]
    with tempfile.TemporaryDirectory() as folder, running_rig(Path(folder), str(SCENE), [*presses, *patient]) as rig:
        seen = strike_by_chance(rig, options.seed, options.count)
    table = page(options.seed, seen)
    print(table)
    if options.report is not None:
        with whole_file(options.report) as half:
            half.write_text(table, encoding="utf-8")
    return int(any(why for _, why in seen))


if __name__ == "__main__":
    sys.exit(main())
