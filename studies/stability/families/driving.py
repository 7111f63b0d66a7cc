"""A catheter driven at random through a fork or a tube: pushed and drawn back, twisted and steered, by any opening.

The hands are the same in both, and so are the wall and the catheter: what fails more often in the fork fails by the
fork. Each is also driven with a guide wire in it, which is pushed and twisted by a second drive.

The introducer's seal rubs as in every scene with a drive: a catheter stays where it was left. Without it, drag alone
slows what slides: 6 uN keep 0.12 m going at 1 mm/s, and a curved tip in the introducer pushes that hard for seconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from enum import Enum
from functools import cache, partial

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.effects.base import NoSettings
from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.mechanics.scene import (
    CatheterScene,
    CatheterSection,
    DriveScene,
    DuctScene,
    GuideWireScene,
    SceneModel,
    WireDriveScene,
)
from trocar.services.mechanics.scene.duct_branch import DuctBranch
from trocar.services.mechanics.scene.duct_tubes import duct_tubes
from trocar.services.mechanics.simulation.scene_catheter import place_catheter
from trocar.services.mechanics.simulation.scene_duct import scene_mesh
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.meshes.branching import load_branching
from trocar.studies.stability.drive import Play
from trocar.studies.stability.family import Case, Draw, played
from trocar.studies.stability.hands import HandMotions, least_jerk
from trocar.studies.stability.situations import LEAD_STEPS

SPEEDS_M_S = 0.05, 0.1, 0.3
COUNT = 7
MOVES = 4
LENGTH_M, BEFORE_M, MOST_M = 0.12, 4e-3, 55e-3
EDGE_M = 1.6e-3

FORK = SceneModel(
    duct=DuctScene(
        radius_m=4.5e-3,
        length_m=30e-3,
        n_modes=40,
        thickness_m=1e-3,
        youngs_modulus_pa=300e3,
        branches=(
            DuctBranch(name="left", angle_rad=0.55, radius_m=3.6e-3, length_m=24e-3, end="free"),
            DuctBranch(name="right", angle_rad=0.55, azimuth_rad=math.pi, radius_m=3.6e-3, length_m=24e-3),
        ),
    ),
    catheter=CatheterScene(
        n_segments=60,
        length_m=LENGTH_M,
        before_mouth_m=BEFORE_M,
        introducer_to_tip_m=8e-3,
        introducer_length_m=LENGTH_M - 8e-3,
        introducer_seal_friction_n=20e-3,
        outer_diameter_m=1.6e-3,
        youngs_modulus_pa=30e6,
        sections=(CatheterSection(length_m=14e-3, youngs_modulus_pa=10e6, steering_1_m_rad=(70.0, 0.0, 0.0)),),
    ),
    forceps=(DriveScene(),),
    effects={"twist": NoSettings(), "friction": FrictionSettings(mu_static=0.1, mu_kinetic=0.1)},
)


TUBE = replace(FORK, duct=replace(FORK.duct, length_m=54e-3, branches=()))
WIRE = GuideWireScene(
    outer_diameter_m=0.45e-3,
    youngs_modulus_pa=50e9,
    reach_m=30e-3,
    sections=(CatheterSection(length_m=14e-3, youngs_modulus_pa=15e9, rest_curvature_1_m=(80.0, 0.0, 0.0)),),
)


class Wall(Enum):
    """A wall, by the openings that a catheter comes by."""

    FORK = "mouth", "left", "right"
    TUBE = "mouth", "clamped"


@cache
def mesh_of(wall: Wall) -> TriangleMesh:
    """Return the triangles of a wall: of the fork a trunk and two branches, one of them held; the tube is as long."""
    return load_branching(duct_tubes(FORK.duct), EDGE_M) if wall is Wall.FORK else scene_mesh(TUBE.duct)


def cases(draw: Draw, wall: Wall = Wall.FORK, wire: GuideWireScene | None = None) -> Iterator[Case]:
    """By every opening, at every speed of a hand."""
    for opening in wall.value:
        for speed in SPEEDS_M_S if draw.is_long else (0.1,):
            for k in range(COUNT if draw.is_long else 1):
                name = f"{opening}, {speed:g} m/s, number {k}"
                random = partial(draw.random, f"driving {name}")
                yield played(name, partial(_play, scene_of(wall, opening, wire), wall, random, speed))


def scene_of(wall: Wall, opening: str, wire: GuideWireScene | None) -> SceneModel:
    """Return what is driven, with a drive for the wire if there is one."""
    scene = FORK if wall is Wall.FORK else TUBE
    catheter = replace(scene.catheter, opening=opening, guide_wire=wire)
    if wire is None:
        return replace(scene, catheter=catheter)
    catheter = replace(catheter, before_mouth_m=BEFORE_M + wire.out_m)  # both start outside
    return replace(scene, catheter=catheter, forceps=(*scene.forceps, WireDriveScene()))


def _play(scene: SceneModel, wall: Wall, random: Callable[[], np.random.Generator], speed_m_s: float) -> Play:
    mesh = mesh_of(wall)
    return Play(scene=scene, hands=random_drive(place_catheter(scene, mesh), random(), speed_m_s), mesh=mesh)


def random_drive(placed: SceneModel, random: np.random.Generator, speed_m_s: float) -> HandMotions:
    """Push to random depths, by turns with random rolls of up to a turn and random angles of the handle.

    A guide wire is rolled instead of the catheter, and pushed out of it to a random length.
    """
    catheter, wire = placed.catheter, placed.catheter.guide_wire
    along, out_m = np.array(catheter.direction), wire.out_m if wire is not None else 0.0
    ways: list[FloatArray] = [np.tile([0.0, 0.0, 0.0, out_m], (LEAD_STEPS, 1))]  # depth, roll, handle, wire
    for _ in range(MOVES):
        now = ways[-1][-1]
        depth_m, turned, handle = random.uniform(0.0, MOST_M), random.uniform(-6.0, 6.0), random.uniform(0.0, 1.0)
        to = np.array([depth_m, now[1] + turned, handle, now[3]])
        if wire is not None:
            to[3] = random.uniform(wire.least_out_m, wire.reach_m)
        steps = len(least_jerk(abs(to[0] - now[0]), along, speed_m_s))
        share = np.linspace(0.0, 1.0, max(steps, 200))[:, None]
        ways.append(now + share**3 * (10.0 + share * (6.0 * share - 15.0)) * (to - now))
    table = np.concatenate(ways)
    position = np.zeros((len(table), 2, 3))
    position[:, 0] = np.array(catheter.tip_position_m) - LENGTH_M * along + table[:, :1] * along
    position[:, 1] = position[0, 0] + (0.0, 0.0, 0.3)
    if wire is not None:
        position[:, 1] = position[:, 0] + (table[:, 3:] - out_m - 0.5 * WireDriveScene().behind_m) * along
    present = np.tile([True, wire is not None], (len(table), 1))
    pad = np.zeros(len(table))
    rolls = (table[:, 1], pad) if wire is None else (pad, table[:, 1])
    return HandMotions(present, position, np.stack([table[:, 2], pad], 1), np.stack(rolls, 1))
