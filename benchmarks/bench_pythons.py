"""A tick of an insertion with each Python given, in turns, and with kernels for the processor at hand.

    python benchmarks/bench_pythons.py --pythons .venv/bin/python,build/python-3.13/bin/python,forky:/usr/bin/python3

Each is the interpreter of an environment in which Trocar is installed; with a colon, that of a system of its own in a
folder, which finds the program as ``/tmp/insertion_ticks.py``. The first also runs kernels that it compiles for the
processor at hand: shipped kernels, which are for a fixed target, should take no longer.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

from report import Row, parse, write_report

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = ROOT / "benchmarks" / "insertion_ticks.py"


def run(python: str, **variables: str) -> dict[str, float | str]:
    """Return what one insertion took and where it ended."""
    folder, colon, inside = python.partition(":")
    command = [str(Path(python).absolute()), str(PROGRAM)]
    if colon:
        command = ["chroot", folder, inside, f"/tmp/{PROGRAM.name}"]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | variables
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, cwd="/")
    answer: dict[str, float | str] = json.loads(done.stdout.splitlines()[-1])
    return answer


def host_target(python: str) -> dict[str, str]:
    """Return the environment in which numba compiles for the processor at hand."""
    asked = "import llvmlite.binding as b; print(b.get_host_cpu_name()); print(b.get_host_cpu_features().flatten())"
    name, features = subprocess.run([python, "-c", asked], capture_output=True, text=True, check=True).stdout.split(
        "\n"
    )[:2]
    return {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": features}


def main() -> None:
    arguments = parse(__doc__, rounds=(5, "turns"), pythons=(sys.executable, "interpreters, with commas between them"))
    pythons = arguments.pythons.split(",")
    host = host_target(pythons[0])
    runs = [(python, {}) for python in pythons] + [(pythons[0], host)]
    answers: list[list[dict[str, float | str]]] = [[] for _ in runs]
    for number in range(-1, arguments.rounds):
        for each, (python, variables) in zip(answers, runs, strict=True):
            answer = run(python, **variables)
            if number >= 0:  # the first turn compiles
                each.append(answer)
    rows = []
    for each, (_, variables) in zip(answers, runs, strict=True):
        name = f"Python {each[0]['python']}" + (f", kernels for {host['NUMBA_CPU_NAME']}" if variables else "")
        median_us, p99_us = (statistics.median(float(one[key]) for one in each) for key in ("median_us", "p99_us"))
        ends = {one["end"] for one in each}
        rows.append(Row(name, median_us, "us", p99=p99_us, note=f"ends in {len(ends)} way, {sorted(ends)[0]}"))
    write_report("pythons", "A tick of an insertion with each Python", rows)


if __name__ == "__main__":
    main()
