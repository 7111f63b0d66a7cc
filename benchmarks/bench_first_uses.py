"""Each scene of configs/scenes played twice in one process: times of its ticks, the first play and the second.

    python benchmarks/bench_first_uses.py [--scenes default stone] [--mesh FILE]

Writes benchmarks/results/first-uses.md. What only the first play meets, the warm-up of physics has missed. Each scene
has a process of its own. A scene that takes a surface file gets ``--mesh``, and is left out without one.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.runtime.config import config
from trocar.services.runtime.realtime.machine import processor_name
from trocar.services.scenes import load_scene
from trocar.studies.first_uses import Plays

ROOT = Path(__file__).resolve().parents[1]
REPORT = ROOT / "benchmarks" / "results" / "first-uses.md"
HEAD = """# First uses

Made by `python benchmarks/bench_first_uses.py`; do not edit by hand. Processor time of a tick in ms, of two plays of a
scene in one process, which has been warmed up as physics is: median, 99th percentile and the longest. If the first
play has a longer tail than the second one, time and again, the warm-up has missed something; a single long tick in
either is the machine's.

"""
TABLE = """| scene | ticks | first: median | 99 % | longest | second: median | 99 % | longest |
| --- | --- | --- | --- | --- | --- | --- | --- |
"""


def play_here(name: str, overrides: list[str]) -> None:
    """Play a scene twice and print the times as JSON."""
    plays = Plays(load_scene(name, overrides), cache_directory())
    print(json.dumps([plays.play().tolist() for _ in range(2)]))


def line_of(name: str, overrides: list[str]) -> str:
    """Play a scene in a process of its own and return its line of the table."""
    command = [sys.executable, __file__, "--here", name, *overrides]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    plays = [1e3 * np.array(times) for times in json.loads(done.stdout.splitlines()[-1])]
    told = [f"{np.median(ms):.2f} | {np.percentile(ms, 99):.2f} | {ms.max():.2f}" for ms in plays]
    return f"| {name} | {len(plays[0])} | {told[0]} | {told[1]} |"


def main(scenes: list[str], mesh: Path | None) -> None:
    """Play the scenes and write the report."""
    folder = config.config_directory() / "scenes"
    lines = []
    for name in scenes or sorted(path.stem for path in folder.glob("*.yaml")):
        needs_file = "mesh_file" in (folder / f"{name}.yaml").read_text()
        overrides = [f"duct.mesh_file={mesh.absolute()}"] if needs_file and mesh is not None else []
        if (needs_file and mesh is None) or load_scene(name, overrides).duct_alone:
            continue
        lines.append(line_of(name, overrides))
        print(lines[-1], flush=True)
    machine = f"Measured {datetime.now(UTC):%Y-%m-%d} on {processor_name()}.\n\n"
    REPORT.write_text(HEAD + machine + TABLE + "\n".join(lines) + "\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="*", default=[])
    parser.add_argument("--mesh", type=Path)
    parser.add_argument("--here", nargs="+", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.here:
        play_here(arguments.here[0], arguments.here[1:])
    else:
        main(arguments.scenes, arguments.mesh)
