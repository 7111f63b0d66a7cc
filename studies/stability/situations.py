"""Where hard cases begin: scenes, and both hands until the trouble starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import CatheterScene, SceneModel
from trocar.studies.stability.hands import HandMotions, eased, junction, still

LEAD_STEPS = 250
"""Steps of 1 ms in which jaws close and everything comes to rest, before anything hard happens."""
GRIP_M = 66e-3, 0.0, 0.0
STEADY_M = 28e-3, 0.0, 0.0


@dataclass(frozen=True, slots=True)
class Situation:
    """A scene and what the hands do at first."""

    scene: SceneModel
    hands: HandMotions


def threaded() -> Situation:
    """The insertion half way: catheter 16 mm in the duct, one forceps holds it, the other steadies the duct."""
    scene = insertion_scene()
    catheter = replace(scene.catheter, tip_position_m=(24e-3, 0.0, 0.0))
    scene = replace(scene, catheter=catheter)
    return Situation(scene, _closing(scene, (0.7, 1.15), (0.25, 0.8)))


def approaching() -> Situation:
    """The catheter short of the mouth, held by one forceps; the other steadies the duct."""
    scene = insertion_scene()
    return Situation(scene, _closing(scene, (0.7, 1.15), (0.25, 0.8)))


def beside() -> Situation:
    """The catheter in the duct, both forceps open above and beside, holding nothing."""
    scene = threaded().scene
    points = [
        junction(forceps, at, 10e-3)
        for forceps, at in zip(scene.forceps, ((66e-3, 0.0, 12e-3), (20e-3, 0.0, 12e-3)), strict=True)
    ]
    return Situation(scene, still(np.array(points), (0.3, 0.3), LEAD_STEPS))


def frictionless() -> Situation:
    """As `beside`, but clamped and without any friction: one shape of rest, whatever happened before."""
    start = beside()
    scene = without_friction(start.scene)
    return Situation(with_catheter(scene, anchor="clamped", length_m=80e-3, n_segments=40), start.hands)


def without_friction(scene: SceneModel) -> SceneModel:
    """The scene without friction in contacts, in the introducer and its seal."""
    effects = {name: settings for name, settings in scene.effects.items() if name != "friction"}
    free = replace(scene.catheter, introducer_friction=0.0, introducer_seal_friction_n=0.0)
    return replace(scene, effects=effects, catheter=free)


def with_catheter(scene: SceneModel, **changes: object) -> SceneModel:
    """The scene with another catheter."""
    catheter: CatheterScene = replace(scene.catheter, **changes)  # type: ignore[arg-type]
    return replace(scene, catheter=catheter)


def with_duct(scene: SceneModel, **changes: object) -> SceneModel:
    """The scene with another duct."""
    return replace(scene, duct=replace(scene.duct, **changes))  # type: ignore[arg-type]


def with_effects(scene: SceneModel, effects: Mapping[str, object]) -> SceneModel:
    """The scene with these effects besides its own."""
    return replace(scene, effects={**scene.effects, **effects})


def _closing(scene: SceneModel, wide: tuple[float, float], shut: tuple[float, float]) -> HandMotions:
    """Both tools in place with open jaws, which close in 120 ms and hold."""
    left, right = scene.forceps
    points = np.array([junction(left, GRIP_M, 10e-3), junction(right, STEADY_M, 12e-3)])
    hands = still(points, wide, LEAD_STEPS)
    part = eased(1.0, np.clip((np.arange(LEAD_STEPS) - 10) / 120.0, 0.0, 1.0))
    for tool in range(2):
        hands = hands.with_jaws(tool, wide[tool] + (shut[tool] - wide[tool]) * part, 0)
    return hands
