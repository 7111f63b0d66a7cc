"""The governor at half the machine's speed: late ticks with the quality ladder and without, and what was given up.

    python benchmarks/bench_governor.py [--scene everything] [--seconds 15] [--share 0.5] [trocar up's options]

Runs the rig three times for each of ``--runs``: with the scene as it is, and with nothing of its ladder but the first
rung, or the last.
Once the rig runs, `slow_core` takes ``--share`` of each of its cores. Ticks are counted over the whole run, with the
seconds that the governor takes to act, and from its last act on. `machine_floor` says what else the load takes: two
cores that are one to the host share its arithmetic, so that what is left of a core is slower, too. What any program
would lose there is told by `bare_loop`, with as much to do in a millisecond as the rig's loops of that core in a run
without the load.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from machine_floor import Floor
from report import Row, write_report

from trocar.services.runtime.config import config

ROOT = Path(__file__).resolve().parents[1]
CORES = (0, 1)
LOOPS = ("gateway", "haptics", "physics")
#: So long the idle machine is watched first.
IDLE_S = 3.0


@contextmanager
def slowed(seconds: float, share: float) -> Iterator[None]:
    """Take a share of each core."""
    command = [sys.executable, str(ROOT / "benchmarks/slow_core.py")]
    started = [
        subprocess.Popen([*command, str(core), str(seconds), str(share)], stdout=subprocess.PIPE) for core in CORES
    ]
    try:
        for process in started:
            assert process.stdout is not None
            if not process.stdout.readline():
                raise SystemExit("the load did not begin")
        yield
    finally:
        for process in started:
            process.terminate()
            process.wait()


def run_rig(scene: Path, seconds: float, share: float, options: list[str]) -> dict[str, Any]:
    """Return the report of one run, the load beside it as soon as the rig is running; none where its share is 0."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.json"
        command = [str(Path(sys.executable).with_name("trocar")), "up", "--scene", str(scene), "--viewer", "none"]
        command += ["--seconds", str(seconds), "--json", str(file), "--set", f"transport.directory={folder}/bus"]
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
        process = subprocess.Popen(
            [*command, *options], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
        )
        assert process.stdout is not None
        said = []
        for line in process.stdout:
            said.append(line)
            if "is running" in line:
                break
        with slowed(seconds, share) if share else nullcontext(), Floor(seconds) as floor:
            said.append(process.communicate()[0])
        if not file.is_file():
            raise SystemExit(f"trocar up ended with {process.returncode}:\n{''.join(said)[-2000:]}")
        report: dict[str, Any] = json.loads(file.read_text())
    return report | {"arithmetic_us": mean_arithmetic_us(floor)}


def bare_loops(seconds: float, share: float, work_us: dict[int, float]) -> dict[int, float]:
    """Return the percentage of ticks that a bare loop of each core loses below the load."""
    command = [sys.executable, str(ROOT / "benchmarks/bare_loop.py")]
    loops = {
        core: subprocess.Popen(
            [*command, str(core), str(seconds), str(us)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for core, us in work_us.items()
    }
    for loop in loops.values():
        assert loop.stdout is not None
        if not loop.stdout.readline():
            raise SystemExit("a bare loop did not begin")
    with slowed(seconds + 2.0, share):
        return {core: float(loop.communicate("\n")[0]) for core, loop in loops.items()}


def work_per_core_us(run: dict[str, Any]) -> dict[int, float]:
    """Return the median work of the loops of each core: gateway and haptics share the first, physics has the last."""
    work = {loop: float(run["loops"][loop]["work_us"]["p50"]) for loop in LOOPS}
    return {CORES[0]: work["gateway"] + work["haptics"], CORES[1]: work["physics"]}


def mean_arithmetic_us(floor: Floor) -> float:
    """Return how long a fixed piece of arithmetic took: medians of the cores, their mean."""
    return float(np.mean([core["arithmetic_us"] for core in floor.cores]))


def one_rung_only(scene: str, folder: Path, rung: int) -> Path:
    """Write the scene without the rest of its ladder."""
    path = config.find("scene", scene)
    data = config.read_yaml(path)
    data["quality"] = [data.get("quality", [{}])[rung]]
    if mesh_file := data.get("duct", {}).get("mesh_file"):
        data["duct"]["mesh_file"] = str((path.parent / mesh_file).absolute())
    alone = folder / f"rung{rung}.yaml"
    alone.write_text(yaml.safe_dump(data, sort_keys=False))
    return alone


def rows_of(name: str, runs: list[dict[str, Any]], idle_us: float) -> list[Row]:
    """Return medians over runs of one kind."""
    rows = []
    for loop in LOOPS:
        misses = [100.0 * float(run["loops"][loop]["miss_ratio"]) for run in runs]
        rows.append(Row(f"{name}: {loop}, late or lost ticks", float(np.median(misses)), "%"))
    if any(len(run["rungs"]) > 1 for run in runs):
        for loop in LOOPS:
            settled = [settled_percent(run, loop) for run in runs]
            rows.append(
                Row(f"{name}: {loop}, the same from the governor's last act on", float(np.median(settled)), "%")
            )
    work = [float(run["loops"]["physics"]["work_us"]["p50"]) for run in runs]
    rows.append(Row(f"{name}: physics, work", float(np.median(work)), "us"))
    slower = float(np.median([run["arithmetic_us"] for run in runs])) / idle_us
    rows.append(Row(f"{name}: arithmetic while the core is had, over the idle machine's", slower, ""))
    rows.append(Row(f"{name}: quality level at the end", float(np.median([run["quality_level"] for run in runs])), ""))
    return rows


def settled_percent(run: dict[str, Any], loop: str) -> float:
    """Return what a loop lost on the rung on which the run ended."""
    counts: dict[str, int] = run["rungs"][-1]["loops"][loop]
    return 100.0 * counts["misses"] / max(1, counts["ticks"] + counts["skipped"])


def deeds(run: dict[str, Any]) -> list[str]:
    """Return what the supervisor did, and why, and which process ended: what it says of contracts alone is left out."""
    acts = ("quality level", "supervisor: restart", "killed to be started again")
    return [
        f"{event['t']:.1f} s: {event['text']}"
        for event in run["events"]
        if event["level"] == "error" or any(act in event["text"] for act in acts)
    ]


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="everything")
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--share", type=float, default=0.5, help="of each core that the load takes")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--name", default="governor", help="of the table in benchmarks/results")
    arguments, options = parser.parse_known_args()
    with Floor(IDLE_S) as idle:
        pass
    with tempfile.TemporaryDirectory() as folder:
        scenes = {
            "with the ladder": config.find("scene", arguments.scene),
            "first rung only": one_rung_only(arguments.scene, Path(folder), 0),
            "last rung only": one_rung_only(arguments.scene, Path(folder), -1),
        }
        runs: dict[str, list[dict[str, Any]]] = {name: [] for name in scenes}
        floors: list[dict[int, float]] = []
        unloaded = run_rig(scenes["with the ladder"], arguments.seconds, 0.0, options)
        work_us = work_per_core_us(unloaded)
        for _ in range(arguments.runs):
            for name, scene in scenes.items():
                runs[name].append(run_rig(scene, arguments.seconds, arguments.share, options))
            floors.append(bare_loops(arguments.seconds, arguments.share, work_us))
    rows = [row for name, found in runs.items() for row in rows_of(name, found, mean_arithmetic_us(idle))]
    rows += rows_of("without the load", [unloaded], mean_arithmetic_us(idle))
    rows += [
        Row(
            f"floor: a bare loop with {us:.0f} us of work on core {core} below the load, late or lost ticks",
            float(np.median([floor[core] for floor in floors])),
            "%",
        )
        for core, us in work_us.items()
    ]
    said = {name: [line for run in found for line in deeds(run)] for name, found in runs.items()}
    notes = (
        f"{arguments.runs} runs of {arguments.seconds:g} s each of the scene `{arguments.scene}`, interleaved; a load "
        f"above the rig's priorities takes {100 * arguments.share:g} % of each core in every 0.487 ms. What the "
        "supervisor did, seconds since the start: "
        + "; ".join(f"{name}: {', '.join(lines) or 'nothing'}" for name, lines in said.items())
        + "."
    )
    write_report(arguments.name, "The governor", rows, notes)


if __name__ == "__main__":
    main()
