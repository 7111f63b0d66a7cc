"""Environments in batches: steps a second and memory of 1, 2, 8 and 64 scenes of one process, beside a process each.

    python -m benchmarks.bench_batch [--moments 100]

Every figure is of a new process, pinned to one core with all its children, so that scenes and not cores are counted.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from benchmarks.report import Row, parse, write_report
from trocar.envs import Batch, Expert

NAME = "trocar/Insertion-v0"
SCENES, PROCESSES = (1, 2, 8, 64), (2, 8)
APART = 37
"""Steps by which each scene begins later than the one before: scenes are in different parts of an insertion."""
NOTES = """Scenario `basic` (20 ms an action), the actions of an expert's insertion; each scene begins {apart}
steps after the one before, so that at any time scenes reach, grip, push and begin anew. Steps of
all scenes by the processor time of all processes, over {moments} steps of each scene, after a whole
insertion of each; all on one core. Memory is the proportional share (PSS) of all processes, whose
program and compiled kernels the row of one scene shows. What scenes share: mesh, basis, residual
compliance (mapped from its file, which processes share as well) and the cache of its rows. What
each has: states, contacts, lists of candidates, and the matrices of the contact solve as far as
contacts have filled them.
"""


def expert_actions() -> np.ndarray:
    """Return the actions (steps, ...) of an insertion, up to its end."""
    env = gymnasium.make(NAME)
    env.reset(seed=0)
    expert, actions, ended = Expert(env.unwrapped), [], False  # type: ignore[arg-type]
    while not ended:
        actions.append(expert.action())
        *_, terminated, truncated, _ = env.step(actions[-1])
        ended = terminated or truncated
    env.close()
    return np.array(actions, np.float32)


def measure(n: int, jobs: int, moments: int, actions: np.ndarray) -> dict[str, float]:
    """Step a batch through a whole insertion of each scene, then measure."""
    batch = Batch(NAME, n, jobs=jobs)
    batch.reset(seed=0)
    at, began_s = -APART * np.arange(n) % len(actions) - len(actions), 0.0
    for moment in range(2 * len(actions) + moments):
        given = np.zeros((n, *actions.shape[1:]), np.float32)
        moving = (at >= 0) & (at < len(actions))
        given[moving] = actions[at[moving]]
        if moment == 2 * len(actions):
            began_s = _processor_s()
        *_, terminated, truncated, _ = batch.step(given)
        at = np.where(terminated | truncated, -1, at + 1)
    found = {"rate": n * moments / (_processor_s() - began_s), "memory": _memory_mb()}
    batch.close()
    return found


def _processes() -> list[int]:
    own = os.getpid()
    return [own, *map(int, Path(f"/proc/{own}/task/{own}/children").read_text().split())]


def _processor_s() -> float:
    """Return the processor time of this process and of all its children."""
    fields = [Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for pid in _processes()]
    return sum(int(each[11]) + int(each[12]) for each in fields) / os.sysconf("SC_CLK_TCK")


def _memory_mb() -> float:
    """Return the proportional share of this process and of all its children."""
    kept = (Path(f"/proc/{pid}/smaps_rollup").read_text() for pid in _processes())
    return sum(int(line.split()[1]) for text in kept for line in text.splitlines() if line.startswith("Pss:")) / 1024


def _measured(n: int, jobs: int, moments: int, actions: Path) -> dict[str, float]:
    """Measure in a new process."""
    command = [sys.executable, "-m", "benchmarks.bench_batch", "--scenes", str(n), "--jobs", str(jobs)]
    command += ["--moments", str(moments), "--actions", str(actions)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    print(n, jobs, found, flush=True)
    return found


def _rows(moments: int) -> list[Row]:
    with tempfile.TemporaryDirectory() as folder:
        np.save(actions := Path(folder) / "actions.npy", expert_actions())
        together = {n: _measured(n, 1, moments, actions) for n in SCENES}
        apart = {n: _measured(n, n, moments, actions) for n in PROCESSES}
    rows = []
    for figure, unit in (("rate", "steps/s"), ("memory", "MB")):
        name = "steps of all scenes" if figure == "rate" else "memory"
        rows += [Row(f"{name}, {_scenes(n)} in one process", each[figure], unit) for n, each in together.items()]
        rows += [Row(f"{name}, {n} processes of one scene each", each[figure], unit) for n, each in apart.items()]
    few, many = SCENES[0], SCENES[-1]
    rows.append(Row("each further scene", (together[many]["memory"] - together[few]["memory"]) / (many - few), "MB"))
    few, many = PROCESSES
    rows.append(Row("each further process", (apart[many]["memory"] - apart[few]["memory"]) / (many - few), "MB"))
    return rows


def _scenes(n: int) -> str:
    return "1 scene" if n == 1 else f"{n} scenes"


def main() -> None:
    """Measure and write the table, or one figure of it."""
    given: Any = parse(
        __doc__,
        moments=(100, "steps of each scene that are measured"),
        scenes=(0, "of one figure"),
        jobs=(1, "processes"),
        actions=("", "a file of actions"),
    )
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    if given.scenes:
        print(json.dumps(measure(given.scenes, given.jobs, given.moments, np.load(given.actions))))
        return
    rows = _rows(given.moments)
    write_report("batch", "Environments in batches", rows, NOTES.format(apart=APART, moments=given.moments))


if __name__ == "__main__":
    main()
