"""Folds of drawn cystic ducts against a catheter: ``python -m trocar.studies.cystic_folds``.

A drive pushes a 5 Fr catheter with a bent tip from an introducer without friction into the duct of each seed: what the
drive feels is then the tissue's alone. A hand that only pushes gives up where it feels more than its limit; one that
also turns draws back there, turns the catheter and tries again; and in a third run the neck is pulled meanwhile. A
straight tip is turned, too, to see what the bend is worth. Each seed's runs are kept in ``--out``, so that a study may
be continued; the page is written of all that are there.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.reduction.build import ignore_progress
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scene import CatheterSection, SceneModel
from trocar.services.mechanics.scene.cystic_duct import SPIRAL, CysticDuctScene, drawn_cystic_duct
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.scenes.load import load_scene
from trocar.services.scenes.ready import load_duct
from trocar.studies.cystic_folds_page import write_page
from trocar.studies.fold_stiffness import crest_stiffness_n_m

PACE_M_S, BEFORE_M = 20e-3, 4e-3
LIMIT_N = 0.2
"""Assumption: at which a hand stops pushing, ten times what the default scene's seal takes. No figure was found."""
BACK_M, TURN_RAD, TURN_RAD_S, MOST_TRIES = 3e-3, 2.4, 3.0, 8
"""How a hand tries again: it draws back, and turns by the golden angle, so that tries cover the circle evenly. So often
at one fold; at the next it begins anew."""
SAME_FOLD_M = 1e-3
"""A hand that has come further by less is at the fold where it was: they are 2 mm apart at least."""
TRACTION_N = 0.29
"""What stretches a bile duct by a quarter: 5 kPa on the closed end of one 8.6 mm wide (Duch 2004, ten of pigs)."""
SLACK_M = 10e-3
"""By how much more than the way to the goal a hand pushes at most: a catheter that bends away takes it up."""
PAST_M = 7e-3
"""The goal: so far behind the half that has folds, which begins 5 mm behind the mouth."""
FINER = {"edges 0.7 times as long": (0.7, 1e-3), "steps of 0.5 ms": (1.0, 0.5e-3)}
MESHES = (1.0, 0.7, 0.5)
"""Edges, of those of the default mesh, on which folds are pushed statically."""
_SCENE = {
    "duct": {"cystic": {}, "thickness_m": 1.0e-3, "youngs_modulus_pa": 500e3, "n_modes": 24, "traction_n": 0.0},
    "catheter": {
        "product": "cholangiography_5fr", "length_m": 0.1, "n_segments": 50, "before_mouth_m": BEFORE_M,
        "introducer_to_tip_m": 6e-3, "introducer_length_m": 0.09,
    },
    "forceps": [{"kind": "drive"}],
    "effects": {"friction": {"mu_static": 0.1, "mu_kinetic": 0.1}, "twist": {}},
    "hands": "none",
}  # fmt: skip
BENT_TIP = CatheterSection(length_m=15e-3, rest_curvature_1_m=(25.0, 0.0, 0.0))
KINDS = {
    "smooth": "push, no folds", "push": "push", "straight": "push and turn, straight tip", "turn": "push and turn",
    "pull": "push, turn and pull the neck",
}  # fmt: skip


@dataclass(frozen=True)
class Run:
    """One insertion.

    Attributes:
        kind: What the hand does, a key of `KINDS`.
        passed: Whether the tip came past the folds.
        tries: How often the hand has begun again.
        depth_mm, force_mn: How deep the tip was and what the drive felt along the catheter, a hundred times a second.
    """

    seed: int
    kind: str
    how: str
    passed: bool
    tries: int
    depth_mm: list[float]
    force_mn: list[float]


class Hand:
    """Pushes until it feels too much; then it draws back, turns and tries again, if it does that at all."""

    def __init__(self, may_turn: bool) -> None:
        self.way_m = self.roll_rad = 0.0
        self.tries, self._may_turn, self._to_m, self._to_rad = 0, may_turn, 0.0, 0.0
        self._furthest_m, self._tries_here = -SAME_FOLD_M, 0
        self.gives_up = False

    def move(self, felt_n: float, dt_s: float) -> None:
        """Move for a step, after it has felt a force."""
        step_m, step_rad = PACE_M_S * dt_s, TURN_RAD_S * dt_s
        if self.way_m > self._to_m:
            self.way_m -= step_m
        elif self.roll_rad < self._to_rad:
            self.roll_rad += step_rad
        elif felt_n <= LIMIT_N:
            self.way_m += step_m
            self._to_m = self.way_m
        elif self._may_turn and self._tries_again():
            self._to_m, self._to_rad = self.way_m - BACK_M, self.roll_rad + TURN_RAD
        else:
            self.gives_up = True

    def _tries_again(self) -> bool:
        """Count a try, and return whether it is not one too many at this fold."""
        if self.way_m > self._furthest_m + SAME_FOLD_M:
            self._tries_here = 0
        self._furthest_m = max(self._furthest_m, self.way_m)
        self._tries_here += 1
        self.tries += self._tries_here <= MOST_TRIES
        return self._tries_here <= MOST_TRIES


def scene_of(folder: Path, cystic: CysticDuctScene, tip: tuple[CatheterSection, ...] = (BENT_TIP,)) -> SceneModel:
    """Return the study's scene with a duct and a tip."""
    path = folder / "scene.yaml"
    path.write_text(yaml.safe_dump(_SCENE))
    scene = load_scene(path)
    catheter = replace(scene.catheter, sections=tip)
    return replace(scene, duct=replace(scene.duct, cystic=cystic), catheter=catheter)


def insert(scene: SceneModel, duct: ReducedDuct, hand: Hand, goal_m: float, dt_s: float) -> dict[str, Any]:
    """Insert the catheter until its tip is at the goal, the hand gives up or its way is too long."""
    simulation, tools = Simulation(scene, duct), ToolInputs()
    catheter = simulation.scene.catheter
    along = np.array(catheter.direction) / float(np.linalg.norm(catheter.direction))
    begins = np.array(catheter.tip_position_m) - catheter.length_m * along
    tools.present[:] = True, False
    depth_mm, force_mn, every, felt_n, tick, depth_m = [], [], round(10e-3 / dt_s), 0.0, 0, 0.0
    while depth_m < goal_m and not hand.gives_up and hand.way_m < BEFORE_M + goal_m + SLACK_M:
        hand.move(felt_n, dt_s)
        tools.position_m[0], tools.roll_rad[0] = begins + hand.way_m * along, hand.roll_rad
        simulation.step(tools, dt_s)
        felt_n = -float(simulation.tool_results.force_n[0] @ along)
        if tick % every == 0:
            depth_m = simulation.inserted_length_m
            depth_mm.append(round(1e3 * depth_m, 3))
            force_mn.append(round(1e3 * felt_n, 2))
        tick += 1
    return {"passed": depth_m >= goal_m, "tries": hand.tries, "depth_mm": depth_mm, "force_mn": force_mn}


def drawn_duct(seed: int) -> CysticDuctScene:
    """Return the duct of a seed."""
    return drawn_cystic_duct(CysticDuctScene(seed=seed, common_length_m=20e-3))


def runs_of(seed: int, folder: Path) -> list[Run]:
    """Return the insertions into the duct of a seed."""
    drawn, runs = drawn_duct(seed), []
    for kind in KINDS:
        cystic = replace(drawn, folds=0) if kind == "smooth" else drawn
        scene = scene_of(folder, cystic, () if kind == "straight" else (BENT_TIP,))
        if kind == "pull":
            scene = replace(scene, duct=replace(scene.duct, traction_n=TRACTION_N))
        duct = load_duct(scene, cache_directory(), ignore_progress)
        made = insert(scene, duct, Hand(kind in ("straight", "turn", "pull")), goal_m(drawn), 1e-3)
        runs.append(Run(seed, kind, "", **made))
    return runs


def finer_runs(seed: int, folder: Path) -> list[Run]:
    """Return a seed's push on a finer mesh, and with shorter steps."""
    drawn, runs = drawn_duct(seed), []
    scene = scene_of(folder, drawn)
    for how, (share, dt_s) in FINER.items():
        finer = replace(scene, duct=replace(scene.duct, mesh_edge_m=share * usual_edge_m(scene)))
        duct = load_duct(finer, cache_directory(), ignore_progress)
        runs.append(Run(seed, "push", how, **insert(finer, duct, Hand(may_turn=False), goal_m(drawn), dt_s)))
    return runs


def stiffness_of(seed: int, folder: Path) -> dict[str, list[list[float]]]:
    """Return how stiff a seed's folds are along the duct and outwards, in N/m, by the mesh that they have."""
    scene = scene_of(folder, drawn_duct(seed))
    edge_m = usual_edge_m(scene)
    meshed = {f"{share:g}": replace(scene, duct=replace(scene.duct, mesh_edge_m=share * edge_m)) for share in MESHES}
    return {share: [each.tolist() for each in crest_stiffness_n_m(finer)] for share, finer in meshed.items()}


def usual_edge_m(scene: SceneModel) -> float:
    """Return the edge of a scene's smooth wall where it names none."""
    from trocar.services.mechanics.scene.duct_tubes import duct_tubes
    from trocar.services.meshes.branching import EDGE_OF_RADIUS

    return EDGE_OF_RADIUS * min(tube.detail_m() for tube in duct_tubes(scene.duct))


def goal_m(drawn: CysticDuctScene) -> float:
    """Return the depth at which the tip is past the folds."""
    assert drawn.length_m is not None
    return SPIRAL * drawn.length_m + PAST_M


def main() -> None:
    """Run what is missing, and write the page of all that is there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 20), help="first seed, and the one after the last")
    parser.add_argument("--finer", type=int, nargs="*", default=(), help="seeds that are also run finer")
    parser.add_argument("--stiffness", type=int, nargs="*", default=(), help="seeds whose folds are pushed statically")
    parser.add_argument("--out", type=Path, default=Path("study"))
    parser.add_argument("--page", type=Path, help="write the page of all runs in --out")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    wanted = [(runs_of, seed) for seed in range(*asked.seeds)] + [(finer_runs, seed) for seed in asked.finer]
    for make, seed in wanted:
        kept = asked.out / f"{make.__name__}-{seed}.json"
        if not kept.exists():
            kept.write_text(json.dumps([asdict(run) for run in make(seed, asked.out)]))
        for run in json.loads(kept.read_text()):
            print(  # noqa: T201
                f"seed {seed}, {run['kind']} {run['how']}: {max(run['force_mn']):.0f} mN at most, "
                f"{run['depth_mm'][-1]:.1f} mm deep, {'passed' if run['passed'] else 'stopped'}, {run['tries']} tries",
                flush=True,
            )
    for seed in asked.stiffness:
        (asked.out / f"stiffness-{seed}.json").write_text(json.dumps(stiffness_of(seed, asked.out)))
    if asked.page:
        stiff = {int(kept.stem[10:]): json.loads(kept.read_text()) for kept in asked.out.glob("stiffness-*.json")}
        made = [Run(**run) for kept in sorted(asked.out.glob("*runs*-*.json")) for run in json.loads(kept.read_text())]
        write_page(asked.page, made, drawn_duct, (KINDS, LIMIT_N), stiff)


if __name__ == "__main__":
    main()
