"""A tick in drawn cystic ducts with folds beside one of the default scene, in turns, in one process.

    python benchmarks/bench_cystic_tick.py [--seeds 1 12]

Ticks of both scenes alternate, so that whatever else the machine does meets both alike. In the default scene its hands
insert the catheter, in the other a drive pushes it through the folds (`trocar.studies.cystic_folds`). Writes
benchmarks/results/cystic-tick.md.
"""

from __future__ import annotations

import trocar.services.start.entry  # first: the environment of a process

# isort: split
import argparse
import gc
import tempfile
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

import trocar
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction.build import ignore_progress
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.runtime.realtime.machine import processor_name
from trocar.services.scenes.ready import load_duct
from trocar.studies import cystic_folds
from trocar.studies.provenance import code_version

ROOT = Path(__file__).resolve().parents[1]
REPORT = ROOT / "benchmarks" / "results" / "cystic-tick.md"
WARM_UP_TICKS, TICKS = 300, 1800
Step = Callable[[int], int]


def default_scene() -> Step:
    """Return what takes a tick of the default scene, and how long it took in ns."""
    simulation, hands = trocar.simulate(trocar.load_scene("default")), trocar.Hands()
    motion = trocar.expert(simulation)

    def step(tick: int) -> int:
        motion.write_inputs(tick * 1e-3, hands)
        began_ns = time.perf_counter_ns()
        simulation.step(hands)
        return time.perf_counter_ns() - began_ns

    return step


def drawn_duct(seed: int) -> tuple[Step, str]:
    """Return the same of a push into the duct of a seed, and what the duct is."""
    drawn = cystic_folds.drawn_duct(seed)
    with tempfile.TemporaryDirectory() as folder:
        scene = cystic_folds.scene_of(Path(folder), drawn)
    duct = load_duct(scene, cache_directory(), ignore_progress)
    simulation, tools = Simulation(scene, duct), ToolInputs()
    catheter = simulation.scene.catheter
    along = np.array(catheter.direction) / float(np.linalg.norm(catheter.direction))
    begins = np.array(catheter.tip_position_m) - catheter.length_m * along
    tools.present[:] = True, False
    most_m = cystic_folds.BEFORE_M + cystic_folds.goal_m(drawn)

    def step(tick: int) -> int:
        tools.position_m[0] = begins + min(cystic_folds.PACE_M_S * 1e-3 * tick, most_m) * along
        began_ns = time.perf_counter_ns()
        simulation.step(tools)
        return time.perf_counter_ns() - began_ns

    return step, f"seed {seed}: {drawn.course}, {drawn.folds} folds, {duct.basis.n_nodes} nodes"


def measure(steps: list[Step]) -> list[FloatArray]:
    """Return the times of the ticks of each in us, taken in turns."""
    gc.disable()
    times = [[step(tick) for step in steps] for tick in range(TICKS)]
    gc.enable()
    return list(1e-3 * np.array(times[WARM_UP_TICKS:], dtype=np.float64).T)


def main(seeds: list[int]) -> None:
    """Measure and write the table."""
    lines = [
        "# A tick in a drawn cystic duct",
        "",
        f"Made by `python benchmarks/bench_cystic_tick.py`, {datetime.now(UTC):%Y-%m-%d}, code {code_version(ROOT)}, "
        f"{processor_name()}; do not edit by hand.",
        "",
        "Ticks of the default scene and of a push through the folds alternate in one process. Times are in us; the",
        "ratio is that of the medians.",
        "",
        "| duct | tick: median, mean, 99 % | of the default scene | ratio |",
        "| --- | --- | --- | --- |",
    ]
    for seed in seeds:
        step, what = drawn_duct(seed)
        usual, folded = measure([default_scene(), step])
        told = [f"{np.median(t):.0f}, {np.mean(t):.0f}, {np.percentile(t, 99):.0f}" for t in (folded, usual)]
        lines.append(f"| {what} | {told[0]} | {told[1]} | {np.median(folded) / np.median(usual):.2f} |")
        print(lines[-1], flush=True)
    REPORT.write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 12])
    main(parser.parse_args().seeds)
