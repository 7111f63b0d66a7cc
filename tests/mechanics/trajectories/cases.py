"""Three runs of 3,000 ticks of which a few figures are kept beside the tests.

They are made to go through as much of the mechanics as a run can: every effect, both kinds of holds, folds, the rim,
stones, tools that press and slide, a mesh of a scan. What they show is not judged here, only that it stays the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trocar.services.mechanics.effects import EFFECTS as TABLE
from trocar.services.mechanics.effects.base import NoSettings
from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.mechanics.reduction.reduced_duct import ReducedDuct
from trocar.services.mechanics.scenarios import PlayedScene, ToolMotion, insertion
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.mechanics.simulation.scene_duct import build_scene_duct
from trocar.services.scenes import load_duct, load_scene

TICKS = 3000
DT_S = 1e-3
ANATOMY = Path(__file__).parents[3].parent / "shared" / "data" / "anatomy" / "aorta-surface-open-ends.stl"

# The effects there were when the runs were recorded, in the order of their table; a later one does not change them.
EFFECTS = (
    "anisotropy",
    "large_rotations",
    "insufflation",
    "gravity",
    "twist",
    "nonlinear_membrane",
    "viscoelasticity",
    "gallstones",
    "self_contact",
    "mucus_drag",
    "friction",
    "grasp_slip",
)
HandMotions = Callable[[int, ToolInputs], None]


@dataclass(frozen=True)
class Case:
    """A scene with its duct, and what both hands do in each tick."""

    scene: SceneModel
    duct: ReducedDuct
    move: HandMotions


def insertion_with_every_effect(cache_dir: Path) -> Case:
    """The catheter is slid 20 mm into the duct, with all effects at once."""
    scenario = insertion()
    scene = replace(scenario.scene, effects={name: TABLE[name].kind.Settings() for name in EFFECTS})

    def move(tick: int, tools: ToolInputs) -> None:
        scenario.write_inputs(tick * DT_S, tools)

    return Case(scene, build_scene_duct(scene, cache_dir), move)


def pinch_with_both_tools(cache_dir: Path) -> Case:
    """Two forceps close on the duct from both sides, hold its wall, pull, let go, and press on it with shut jaws."""
    scene = insertion().scene
    left, right = scene.forceps
    ports = (14e-3, 70e-3, 110e-3), (30e-3, -70e-3, 110e-3)
    forceps = (
        replace(left, port_position_m=ports[0], jaw_max_angle_rad=1.3),
        replace(right, port_position_m=ports[1], jaw_max_angle_rad=1.3),
    )
    scene = replace(scene, forceps=forceps, effects={"friction": FrictionSettings(), "grasp_slip": NoSettings()})
    # Places where both jaws take one fold: where they span more than 4 mm of wall they only squeeze it.
    motions = (_pinching_hand(14e-3, -2e-3, 0.5), _pinching_hand(28e-3, 3e-3, 0.5))
    scenario = PlayedScene("pinch", "both forceps squeeze the duct", TICKS * DT_S, scene, motions)

    def move(tick: int, tools: ToolInputs) -> None:
        scenario.write_inputs(tick * DT_S, tools)

    return Case(scene, build_scene_duct(scene, cache_dir), move)


def _pinching_hand(x_m: float, pull_m: float, shut_rad: float) -> ToolMotion:
    """Over the duct at ``x_m``, down, shut, a pull along the duct and up, back, open, away, shut, down on top of it."""
    above, at, top = (x_m, 0.0, 18e-3), (x_m, 0.0, 0.0), (x_m, 0.0, 7e-3)
    pulled = (x_m + pull_m, 0.0, 0.5 * abs(pull_m))
    return ToolMotion(
        time_s=(0.0, 0.4, 0.8, 0.9, 1.3, 1.5, 1.7, 2.0, 2.3, 2.5, 2.8),
        grip_point_m=(above, at, at, at, pulled, pulled, at, at, above, above, top),
        jaw_angle_rad=(1.2, 1.2, shut_rad, shut_rad, shut_rad, shut_rad, shut_rad, 1.2, 1.2, 0.0, 0.0),
        roll_rad=(0.5 * math.pi,) * 11,
        grip_offset_m=12e-3,
    )


def poked_anatomy(cache_dir: Path) -> Case:
    """Two forceps poke a scanned vessel from both sides, in and out four and six times a second.

    Raises
    ------
    FileNotFoundError
        The scan is not on this machine.
    """
    if not ANATOMY.exists():
        raise FileNotFoundError(f"{ANATOMY.name}, which is not part of the repository")
    scene = load_scene("anatomy", [f"duct.mesh_file={ANATOMY}"])
    return Case(scene, load_duct(scene, cache_dir, lambda stage, fraction: None), _poke)


def _poke(tick: int, tools: ToolInputs) -> None:
    reach_m = 6e-3 * 0.5 * (1.0 - np.cos(2.0 * np.pi * tick * np.array([4e-3, 6e-3])))
    tools.position_m[0] = 22e-3 + 4e-3 * np.sin(tick / 300.0), 22.5e-3 - reach_m[0], 1e-3
    tools.position_m[1] = 30e-3, -22.5e-3 + reach_m[1], -1e-3
    tools.jaw_angle_rad[:] = 0.2


CASES: dict[str, Callable[[Path], Case]] = {
    "insertion": insertion_with_every_effect,
    "pinch": pinch_with_both_tools,
    "anatomy": poked_anatomy,
}
