"""Force against depth in drawn cystic ducts, with and without folds: ``python -m trocar.studies.cystic_folds``.

A drive pushes a 5 Fr catheter from an introducer without friction into the duct of each seed, at an even pace, once
without turning and once while it turns to and fro. What the drive feels is then the tissue's alone.
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction.build import ignore_progress
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.cystic_duct import CysticDuctScene
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.scenes.load import load_scene
from trocar.services.scenes.ready import load_duct

PUSH_M_S, BEFORE_M, PUSHED_M = 20e-3, 4e-3, 32e-3
TURN_RAD, TURNS_A_SECOND = 1.5, 1.0
_SCENE = {
    "duct": {"cystic": {}, "thickness_m": 0.8e-3, "youngs_modulus_pa": 500e3, "n_modes": 40},
    "catheter": {
        "product": "cholangiography_5fr", "length_m": 0.1, "n_segments": 50, "before_mouth_m": BEFORE_M,
        "introducer_to_tip_m": 6e-3, "introducer_length_m": 0.09,
    },
    "forceps": [{"kind": "drive"}],
    "effects": {"friction": {"mu_static": 0.1, "mu_kinetic": 0.1}, "twist": {}},
    "hands": "none",
}  # fmt: skip


@dataclass(frozen=True)
class Push:
    """One insertion.

    Attributes:
        pushed_m, depth_m, force_n: (n,) float64. How far the drive has pushed since the mouth, how deep the tip is, and
            the force along the catheter that the drive feels, a hundred times a second.
    """

    seed: int
    folds: int
    turns: bool
    pushed_m: FloatArray
    depth_m: FloatArray
    force_n: FloatArray

    @property
    def peak_n(self) -> float:
        """Largest force."""
        return float(self.force_n.max())

    @property
    def work_j(self) -> float:
        """Work of the push."""
        return float(np.trapezoid(self.force_n, self.pushed_m))


def scene_of(folder: Path, cystic: CysticDuctScene) -> SceneModel:
    """Return the study's scene with a duct."""
    import yaml

    path = folder / "scene.yaml"
    path.write_text(yaml.safe_dump(_SCENE))
    scene = load_scene(path)
    return replace(scene, duct=replace(scene.duct, cystic=cystic))


def push(scene: SceneModel, duct: ReducedDuct, seed: int, *, turns: bool) -> Push:
    """Push the catheter in; it is recorded what the drive feels."""
    simulation, tools = Simulation(scene, duct), ToolInputs()
    catheter = simulation.scene.catheter
    along = np.array(catheter.direction) / float(np.linalg.norm(catheter.direction))
    begins = np.array(catheter.tip_position_m) - catheter.length_m * along
    tools.present[:] = True, False
    rows = []
    for tick in range(round(1e3 * (BEFORE_M + PUSHED_M) / PUSH_M_S)):
        way_m = PUSH_M_S * 1e-3 * tick
        tools.position_m[0] = begins + way_m * along
        tools.roll_rad[0] = TURN_RAD * math.sin(2.0 * math.pi * TURNS_A_SECOND * 1e-3 * tick) if turns else 0.0
        simulation.step(tools)
        if tick % 10 == 0:
            force_n = -float(simulation.tool_results.force_n[0] @ along)
            rows.append((way_m - BEFORE_M, simulation.inserted_length_m, force_n))
    cystic = scene.duct.cystic
    assert cystic is not None
    return Push(seed, cystic.folds or 0, turns, *np.array(rows).T)


def pushes(seeds: int, folder: Path) -> Iterator[Push]:
    """Yield the insertions of each seed: with the folds that it draws and without, pushed and turned."""
    from trocar.services.mechanics.scene.cystic_duct import drawn_cystic_duct

    for seed in range(seeds):
        drawn = drawn_cystic_duct(CysticDuctScene(seed=seed, common_length_m=20e-3))
        for cystic in (drawn, replace(drawn, folds=0)):
            scene = scene_of(folder, cystic)
            duct = load_duct(scene, cache_directory(), ignore_progress)
            for turns in (False, True):
                yield push(scene, duct, seed, turns=turns)


def main() -> None:
    """Write the curves and print a line for each insertion."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--out", type=Path, default=Path("study"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    with (asked.out / "cystic_folds.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(("seed", "folds", "turns", "pushed_mm", "depth_mm", "force_mn"))
        for each in pushes(asked.seeds, asked.out):
            for row in zip(each.pushed_m, each.depth_m, each.force_n, strict=True):
                table.writerow((each.seed, each.folds, int(each.turns), *(round(1e3 * float(x), 3) for x in row)))
            file.flush()
            print(  # noqa: T201
                f"seed {each.seed}, {each.folds} folds, {'turned' if each.turns else 'pushed'}: "
                f"{1e3 * each.peak_n:.0f} mN at most, {1e3 * each.work_j:.2f} mJ, {1e3 * each.depth_m[-1]:.1f} mm deep",
                flush=True,
            )


if __name__ == "__main__":
    main()
