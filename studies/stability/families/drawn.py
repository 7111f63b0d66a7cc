"""Scenes in which everything is drawn: duct, wall, catheter, friction, effects, and two hands that cross and squeeze.

Other families vary one thing about the same scene. What nobody thought of is a combination, so here each case has its
own of everything. Nothing is left out because it fails.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from trocar.services.mechanics.effects import EFFECTS
from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.mechanics.effects.gallstones import GallstonesSettings
from trocar.services.mechanics.effects.softening import SofteningSettings
from trocar.services.mechanics.scene import DuctScene, SceneModel
from trocar.services.mechanics.scene.duct_branch import DuctBranch
from trocar.services.mechanics.scene.duct_tubes import duct_tubes
from trocar.services.mechanics.simulation.scene_duct import scene_mesh
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.opening import mouth_opening
from trocar.services.meshes.branching import load_branching
from trocar.studies.stability.crossing import crossing_hands
from trocar.studies.stability.drive import Driven, Play, drive
from trocar.studies.stability.families.ducts import on_axis
from trocar.studies.stability.family import Case, Draw, log_uniform
from trocar.studies.stability.hands import HandMotions
from trocar.studies.stability.situations import threaded, with_catheter, with_duct

COUNT, QUICK_COUNT = 200, 12
LENGTH_M, TRUNK_M = 40e-3, 30e-3
SOFTENED_SHARE = 0.25
"""Of the cases: each of them has a wall of its own to learn from the nonlinear shell, which takes half a minute."""
SQUEEZES = 12
"""That such a wall learns from. Fewer make its law less exact, not less hard."""
TIGHT = 0.95
"""Largest diameter of a catheter, relative to the lumen's at the narrowest place."""

Shape = Callable[[np.random.Generator], dict[str, object]]

SHAPES: dict[str, Shape] = {
    "straight": lambda _: {},
    "conical": lambda random: {"taper": random.uniform(-0.3, 0.4)},
    "curved": lambda random: {"curvature_1_m": random.uniform(3.0, 12.0)},
    "slit": lambda random: {
        "slit_length_m": random.uniform(4e-3, 15e-3),
        "slit_width_m": random.uniform(0.5e-3, 3e-3),
    },
    "oblique": lambda random: {"cut_angle_rad": random.choice([-1.0, 1.0]) * random.uniform(0.2, 0.7)},
    "forked": lambda random: {"length_m": TRUNK_M, "branches": _branches(random)},
}
ENTERS = {"curved", "forked"}
"""Shapes in which a straight catheter has no place to begin in: it begins before the mouth."""


def cases(draw: Draw) -> Iterator[Case]:
    """So many scenes as were asked for, each of its own."""
    count = draw.cases or (COUNT if draw.is_long else QUICK_COUNT)
    for k in range(count):
        drawn = partial(_draw, draw, k)
        yield Case(f"number {k}", partial(_drive, drawn), partial(_play, drawn), partial(_traits, drawn))


@dataclass(frozen=True, slots=True)
class Drawn:
    """A scene, with what its hands are drawn from.

    Attributes:
        shape: str. One of `SHAPES`.
        scene: SceneModel
        random: numpy.random.Generator
    """

    shape: str
    scene: SceneModel
    random: np.random.Generator


def _draw(draw: Draw, k: int) -> Drawn:
    random = draw.random(f"drawn {k}")
    shape = str(random.choice(list(SHAPES)))
    return Drawn(shape, _scene(random, shape), random)


def _drive(draw: Callable[[], Drawn]) -> Driven:
    return drive(_play(draw))


def _play(draw: Callable[[], Drawn]) -> Play:
    drawn = draw()
    mesh = _mesh(drawn.scene.duct)
    hands = _hands(drawn, mesh)
    is_forked = bool(drawn.scene.duct.branches)
    return Play(scene=drawn.scene, hands=hands, mesh=mesh if is_forked else None, times_ticks=True)


def _traits(draw: Callable[[], Drawn]) -> tuple[str, ...]:
    """What a case has, for rates of those that have the same."""
    drawn = draw()
    duct, catheter, friction = drawn.scene.duct, drawn.scene.catheter, drawn.scene.effects.get("friction")
    lumen_m = _narrowest_m(duct)
    told = {
        f"duct {drawn.shape}": True,
        "wall below 0.05 of the radius": duct.thickness_m < 0.05 * duct.radius_m,
        "wall below 100 kPa": duct.youngs_modulus_pa < 100e3,
        "catheter above half the lumen": catheter.outer_diameter_m > 0.5 * lumen_m,
        "catheter above 200 MPa": catheter.youngs_modulus_pa > 200e6,
        "friction above 0.6": isinstance(friction, FrictionSettings) and friction.mu_static > 0.6,
    }
    return *(name for name, has in told.items() if has), *drawn.scene.effects


def _scene(random: np.random.Generator, shape: str) -> SceneModel:
    radius_m = random.uniform(2.5e-3, 5e-3)
    around = int(random.choice([18, 24, 30]))
    scene = with_duct(
        threaded().scene,
        **{
            "radius_m": radius_m,
            "length_m": LENGTH_M,
            "n_around": around,
            "n_along": int(around * random.uniform(1.0, 1.4)),
            "thickness_m": radius_m * log_uniform(random, 0.02, 0.25),
            "youngs_modulus_pa": log_uniform(random, 20e3, 2e6),
            "poisson_ratio": random.uniform(0.3, 0.48),
            "damping_ratio": random.uniform(0.03, 0.3),
        }
        | SHAPES[shape](random),
    )
    if shape == "forked":
        narrower = tuple(replace(each, radius_m=each.radius_m * radius_m) for each in scene.duct.branches)
        scene = with_duct(scene, branches=narrower)
    catheter_m = log_uniform(random, 0.2 * radius_m, TIGHT * _narrowest_m(scene.duct))
    scene = with_catheter(
        scene,
        outer_diameter_m=catheter_m,
        inner_diameter_m=random.uniform(0.3, 0.7) * catheter_m,
        youngs_modulus_pa=log_uniform(random, 1e6, 2e9),
        n_segments=int(random.integers(30, 60)),
        before_mouth_m=random.uniform(1e-3, 3e-3) if shape in ENTERS else None,
    )
    return replace(scene, effects=_effects(random, scene))


def _branches(random: np.random.Generator) -> tuple[DuctBranch, ...]:
    """Two branches, one of them held; their radii are relative to the trunk's."""
    sides = {"left": 0.0, "right": math.pi}
    free = str(random.choice(list(sides)))
    return tuple(
        DuctBranch(
            name=name,
            angle_rad=random.uniform(0.45, 0.65),
            azimuth_rad=azimuth,
            radius_m=random.uniform(0.7, 0.85),
            length_m=24e-3,
            end="free" if name == free else "held",
        )
        for name, azimuth in sides.items()
    )


def _narrowest_m(duct: DuctScene) -> float:
    """Return the lumen's diameter at its narrowest place, but in branches: a catheter need not enter them."""
    return 2.0 * duct.radius_m * (1.0 - max(duct.taper, 0.0)) - duct.thickness_m


def _mesh(duct: DuctScene) -> TriangleMesh:
    return load_branching(duct_tubes(duct), None) if duct.branches else scene_mesh(duct)


def _effects(random: np.random.Generator, scene: SceneModel) -> dict[str, object]:
    """Every effect by the toss of a coin, as far as they go together."""
    drawn: dict[str, object] = {}
    for name in map(str, random.permutation(list(EFFECTS))):
        if random.random() < (SOFTENED_SHARE if name == "softening" else 0.5):
            drawn[name] = EFFECTS[name].kind.Settings()
    if scene.duct.branches:
        drawn.pop("large_rotations", None)  # that is for a tube with two ends: a scene with both is refused
    if "friction" in drawn:
        static, tool_static = random.uniform(0.0, 1.2, 2)
        kinetic, tool_kinetic = random.uniform(0.5, 1.0, 2) * (static, tool_static)
        drawn["friction"] = FrictionSettings(static, kinetic, tool_static, tool_kinetic)
    if "gallstones" in drawn:
        radius_m = scene.duct.radius_m
        drawn["gallstones"] = GallstonesSettings(((12e-3, 0.0, -0.5 * radius_m),), (0.3 * radius_m,))
    if "softening" in drawn:
        drawn["softening"] = SofteningSettings(SQUEEZES)
    return drawn


def _hands(drawn: Drawn, mesh: TriangleMesh) -> HandMotions:
    """Hands that begin before the mouth and anywhere along the duct."""
    random, duct, mouth = drawn.random, drawn.scene.duct, mouth_opening(mesh)
    before_m = mouth.centre_m - random.uniform(5e-3, 26e-3) * mouth.inward
    along_m = on_axis(duct, random.uniform(10e-3, 36e-3) - LENGTH_M + duct.length_m)
    return crossing_hands(random, drawn.scene, (before_m, along_m), duct.radius_m + 6e-3)
