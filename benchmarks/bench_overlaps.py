"""How deep bodies are in each other in ordinary play of every scene, measured from outside (`trocar.studies.judge`).

    python -m benchmarks.bench_overlaps [--scenes insertion,narrow] [--every 5]

Each scene runs with its own hands. Beside the brute-force depth stands what the solver's rows say at the same ticks:
where the two differ, the rows do not see the overlap.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.report import RESULTS, describe_run, parse
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.contact.laws import HAS_GAP
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.runtime.config.config import config_directory
from trocar.services.scenes import load_duct, load_scene
from trocar.services.scenes.hands import hands_of
from trocar.studies.judge.overlaps import BODIES, Depths, OverlapJudge

NEEDS_A_FILE = {"anatomy"}
"""Scenes that run only with a surface file of the user's."""
_ROWS_WITH_GAP = np.array(HAS_GAP, np.bool_)


@dataclass(frozen=True, slots=True)
class Played:
    """One scene: deepest overlaps in m, what rows said, how many ticks were looked at, states put back."""

    scene: str
    deepest: Depths
    by_rows_m: float
    looks: int
    healed: int


def play(name: str, every: int) -> Played:
    """Run a scene with its hands and look at every `every`-th tick."""
    scene = load_scene(name)
    duct = load_duct(scene, cache_directory(), lambda *_: None)
    simulation, tools = Simulation(scene, duct), ToolInputs()
    hands, judge, rows_m, looks = hands_of(scene, duct.mesh), OverlapJudge(simulation), 0.0, 0
    for tick in range(round(hands.duration_s * 1e3)):
        hands.write_inputs(1e-3 * (tick + 1), tools)
        simulation.step(tools)
        if tick % every == 0:
            judge.look()
            rows_m, looks = max(rows_m, _catheter_rows_m(simulation)), looks + 1
    return Played(name, judge.deepest, rows_m, looks, simulation.healed_states)


def _catheter_rows_m(simulation: Simulation) -> float:
    """Return the largest overlap of the catheter with the wall among the solver's rows."""
    rows = simulation.contacts
    n = rows.n_contacts
    of_catheter = _ROWS_WITH_GAP[rows.law[:n]] & (rows.tool[:n] < 0)
    return float(np.where(of_catheter, -rows.gap_m[:n], 0.0).max(initial=0.0))


def table(played: list[Played]) -> Iterator[str]:
    """Yield the rows of the table, depths in micrometres."""
    yield "| scene | " + " | ".join(f"{name}, um" for name in BODIES) + " | catheter by rows, um | looks | healed |"
    yield "| --- |" + " ---: |" * (len(BODIES) + 3)
    for each in played:
        depths = " | ".join(f"{1e6 * each.deepest[name]:.1f}" for name in BODIES)
        yield f"| {each.scene} | {depths} | {1e6 * each.by_rows_m:.1f} | {each.looks:,} | {each.healed} |"


def scene_names() -> list[str]:
    """Return the scenes of the repository that have a catheter and need no file."""
    names = sorted(path.stem for path in (config_directory() / "scenes").glob("*.yaml"))
    return [name for name in names if name not in NEEDS_A_FILE and not load_scene(name).duct_alone]


def main() -> None:
    """Play, print, and keep the table."""
    given = parse(__doc__, scenes=("", "names, with commas; all without"), every=(5, "look at one tick in so many"))
    played = []
    for name in given.scenes.split(",") if given.scenes else scene_names():
        played.append(play(name, given.every))
        print(list(table(played))[-1], flush=True)
    run = [f"- {key}: {value}" for key, value in describe_run().items()]
    lines = ["# Overlaps in ordinary play, measured from outside", "", *table(played), "", *run]
    (RESULTS / "overlaps.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
