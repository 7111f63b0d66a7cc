"""How well `softening` has the force of the nonlinear shell on other ducts than that of the study of it.

python benchmarks/bench_softened_ducts.py                        # half an hour; writes results/softened_ducts.md
python benchmarks/bench_softened_ducts.py thin anatomy --seeds 6 # some of them, other loads; writes nothing

Each duct learns its own law from 48 squeezes, as a scene's does, and is squeezed by 30 random loads of each seed.
"""

from __future__ import annotations

import os

# Before numpy is loaded: sums are taken in one order.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from report import RESULTS, commit

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.effects.softening import SofteningSettings
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.reduction.softening.training import fetch_softening
from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.scenes.load import load_scene
from trocar.services.scenes.ready import load_duct
from trocar.studies.accuracy.random_squeezes import answers, draw_loads, wrong_by

ANATOMY = Path(__file__).parents[2] / "shared" / "data" / "anatomy" / "aorta-surface-open-ends.stl"
EFFECTS = {"softening": SofteningSettings()}
N_LOADS = 30
DAMPING_RATIO = 0.7
"""The wall comes to rest at each point; statics do not depend on it."""


def _insertion(**changes: float) -> Callable[[], ReducedDuct]:
    def build() -> ReducedDuct:
        duct = replace(insertion_scene().duct, damping_ratio=DAMPING_RATIO, **changes)
        return build_scene_duct(SceneModel(duct=duct, effects=EFFECTS), cache_directory() / "bases")

    return build


def _anatomy() -> ReducedDuct:
    scene = load_scene("anatomy", [f"duct.mesh_file={ANATOMY}"])
    still = replace(scene, duct=replace(scene.duct, damping_ratio=DAMPING_RATIO), effects=EFFECTS)
    return load_duct(still, cache_directory(), lambda stage, part: None)


DUCTS: dict[str, tuple[str, Callable[[], ReducedDuct]]] = {
    "insertion": ("R / t = 4, 20 x 26 cells: that of the study", _insertion()),
    "thin": ("R / t = 8", _insertion(thickness_m=0.5e-3)),
    "thinner": ("R / t = 16", _insertion(thickness_m=0.25e-3)),
    "coarse": ("R / t = 4, 14 x 18 cells", _insertion(n_around=14, n_along=18)),
    "fine": ("R / t = 4, 28 x 34 cells", _insertion(n_around=28, n_along=34)),
    "few modes": ("R / t = 4, 40 modes", _insertion(n_modes=40)),
    "curved": (
        "R / t = 4, tapered by 0.4, bent to a radius of 60 mm",
        _insertion(taper=0.4, curvature_1_m=1.0 / 60e-3),
    ),
    "long": ("R / t = 3, 60 mm long", _insertion(radius_m=3e-3, length_m=60e-3, n_along=44)),
    "anatomy": ("an aorta of three ends, as the scene `anatomy` takes it", _anatomy),
}


def row(name: str, seed: int) -> str:
    """One line of the table."""
    what, build = DUCTS[name]
    duct = build()
    recipe = duct.recipe
    if recipe is None:
        raise ValueError(f"{name}: a duct of unknown making")
    softening = fetch_softening(recipe, duct, SofteningSettings().n_squeezes, cache_directory() / "bases")
    loads = draw_loads(recipe, N_LOADS, seed)
    true = answers(recipe, loads)
    linear, soft = (
        np.array([each[-1] for each in wrong_by(recipe, duct, law, loads, true)]) for law in (None, softening)
    )
    worst = int(np.abs(soft).argmax())
    load, x_m = loads[worst], recipe.mesh.vertices_m
    kind = "pinch" if load.is_pinch else "poke" if load.depth_m > 0.0 else "pull"
    place = f"{kind} at x = {1e3 * x_m[load.node, 0]:.0f} mm"
    return (
        f"| {what} | {len(x_m)} | {seed} | {np.median(np.abs(linear)):.0f}, {np.abs(linear).max():.0f} | "
        f"{np.median(np.abs(soft)):.1f} | {np.percentile(np.abs(soft), 90):.1f} | {soft[worst]:+.1f} ({place}) |"
    )


HEAD = (
    "| duct | nodes | seed | linear wall: median, worst % | median % | 90th percentile % | worst % |",
    "|---|---|---|---|---|---|---|",
)


def main() -> None:
    """Print the table, and write it if all ducts were asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("ducts", nargs="*", help=", ".join(DUCTS))
    parser.add_argument("--seeds", type=int, nargs="+", default=[6])
    given = parser.parse_args()
    for name in given.ducts:
        if name not in DUCTS:
            parser.error(f"there is no duct '{name}'; known: {', '.join(DUCTS)}")
    lines = list(HEAD)
    print(*HEAD, sep="\n", flush=True)
    for name in given.ducts or DUCTS:
        for seed in given.seeds:
            lines.append(row(name, seed))
            print(lines[-1], flush=True)
    if not given.ducts:
        (RESULTS / "softened_ducts.md").write_text("\n".join([*_about(), *lines, ""]))


def _about() -> list[str]:
    return [
        "# Softening on other ducts",
        "",
        "Made by `python benchmarks/bench_softened_ducts.py`, not to be edited by hand: error of the force at the end",
        f"of each of {N_LOADS} random loads against the corotational shell on the same mesh.",
        f"{datetime.now(UTC):%Y-%m-%d}, code {commit()}.",
        "",
    ]


if __name__ == "__main__":
    main()
