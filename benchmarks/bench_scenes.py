"""Each scene of configs/scenes in a running rig: what runs, and what a tick of each loop costs.

    python benchmarks/bench_scenes.py [--scenes default stone] [--seconds 6] [--mesh FILE] [trocar up's options]

Writes docs/reference/scenes.md. Scenes that are named replace their own lines, so that the table can be made in parts.
A scene that takes a surface file gets ``--mesh``, and is left out without one. The stub's hands do in each what it is
for (`trocar.services.scenes.hands`).
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from trocar.services.mechanics.scene import SceneModel
from trocar.services.runtime.config import config
from trocar.services.runtime.realtime.machine import processor_name
from trocar.services.scenes import load_scene

ROOT = Path(__file__).resolve().parents[1]
REPORT = ROOT / "docs" / "reference" / "scenes.md"
LOOPS = ("gateway", "haptics", "physics")
HEAD = """# Scenes, what each runs and what that costs

Made by `python benchmarks/bench_scenes.py`; do not edit by hand. The columns gateway, haptics and physics hold the work
of a tick in us, median and 99 %, in a rig with simulated hands and without a viewer. `-` is a process that the scene
does not need, which is not started. The gateway's work between ticks is not counted. The cells are those of the duct's
mesh, the number after the catheter counts its segments.

| scene | bodies | effects | gateway | haptics | physics | late or lost, physics | measured |
| --- | --- | --- | --- | --- | --- | --- | --- |
"""


def run_rig(scene: str, seconds: float, options: list[str]) -> dict[str, Any]:
    """Return the report of one run."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.json"
        command = [str(Path(sys.executable).with_name("trocar")), "up", "--scene", scene, "--viewer", "none"]
        command += ["--seconds", str(seconds), "--json", str(file)]
        command += ["--set", f"transport.directory={folder}/bus", "--set", f"recorder.directory={folder}/recordings"]
        done = subprocess.run([*command, *options], cwd=ROOT, capture_output=True, text=True, check=False)
        if not file.is_file():
            raise SystemExit(f"{scene}: trocar up ended with {done.returncode}:\n{(done.stdout + done.stderr)[-2000:]}")
        report: dict[str, Any] = json.loads(file.read_text())
    return report


def bodies_of(scene: SceneModel) -> str:
    """Return in words what there is."""
    duct = scene.duct
    cells = "surface file" if duct.mesh_file is not None else f"{duct.n_around} x {duct.n_along} cells"
    if duct.branches:
        cells = f"{len(duct.branches)} branches"
    parts = [f"duct ({cells}, {duct.n_modes} modes)"]
    if not scene.duct_alone:
        parts += [f"catheter ({scene.catheter.n_segments})", *_tools(scene)]
    return ", ".join(parts)


def _tools(scene: SceneModel) -> list[str]:
    counts = Counter(tool.kind for tool in scene.forceps)
    return [f"{n} {kind}{'s' if n > 1 and kind != 'forceps' else ''}" for kind, n in counts.items()] or ["no tools"]


def line_of(name: str, scene: SceneModel, run: dict[str, Any]) -> str:
    """Return the scene's line of the table."""
    loops = run["loops"]
    work = [_work(loops[loop]["work_us"]) if loop in loops else "-" for loop in LOOPS]
    late = f"{100.0 * loops['physics']['miss_ratio']:.2g} %"
    effects = ", ".join(scene.effects) or "none"
    when = f"{datetime.now(UTC):%Y-%m-%d}, {processor_name()}, {os.cpu_count()} cores"
    return " | ".join((f"| `{name}`", bodies_of(scene), effects, *work, late, f"{when} |"))


def _work(work_us: dict[str, float]) -> str:
    return f"{work_us['p50']:.0f}, {work_us['p99']:.0f}"


def known_lines() -> dict[str, str]:
    """Return the lines of the table by scene; those that name no machine are of the one that is named above."""
    text = REPORT.read_text(encoding="utf-8") if REPORT.is_file() else ""
    usual = re.search(r"^Measured on (.+), where a line names no other\.$", text, re.MULTILINE)
    lines = {match[1]: match[0] for match in re.finditer(r"^\| `([^`]+)` \|.*$", text, re.MULTILINE)}
    return {name: line if _machine(line) or not usual else _measured(line, usual[1]) for name, line in lines.items()}


def page_of(lines: Sequence[str]) -> str:
    """Return the page; the machine that measured most lines is named once, above the table."""
    (usual, _), *_rest = Counter(map(_machine, lines)).most_common()
    above = HEAD.replace("\n| scene", f"\nMeasured on {usual}, where a line names no other.\n\n| scene")
    return above + "".join(f"{line.removesuffix(f', {usual} |').removesuffix(' |')} |\n" for line in lines)


def _machine(line: str) -> str:
    return line.removesuffix(" |").rpartition(" | ")[2].partition(", ")[2]


def _measured(line: str, machine: str) -> str:
    return f"{line.removesuffix(' |')}, {machine} |"


def main() -> None:
    """Measure, and write what was measured as it comes."""
    every = sorted(path.stem for path in (config.config_directory() / "scenes").glob("*.yaml"))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", choices=every, default=every)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--mesh", type=Path, help="surface file for scenes that take one")
    arguments, options = parser.parse_known_args()
    lines = known_lines()
    for name in arguments.scenes:
        scene, more = load_scene(name), []
        if scene.duct.mesh_file is not None:
            if arguments.mesh is None:
                continue
            more = ["--set", f"duct.mesh_file={arguments.mesh.absolute()}"]
        lines[name] = line_of(name, scene, run_rig(name, arguments.seconds, [*more, *options]))
        print(lines[name], flush=True)
        REPORT.write_text(page_of([lines[each] for each in every if each in lines]), encoding="utf-8")


if __name__ == "__main__":
    main()
