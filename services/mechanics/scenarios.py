"""Scripted hands: breakpoints of both instruments, for tests, benchmarks and the simulated devices.

A scenario is data. Between breakpoints every quantity follows the quintic of least jerk, which starts and stops
at rest, so that velocities are continuous.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trocar.services.mechanics.effects.base import NoSettings
from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.mechanics.effects.gravity import GravitySettings
from trocar.services.mechanics.scene import CatheterScene, DuctScene, ForcepsScene, SceneModel, ToolScene
from trocar.services.mechanics.scene.minimum_jerk import minimum_jerk
from trocar.services.mechanics.scene.tools import N_TOOLS, ToolInputs

Vector3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ToolMotion:
    """Breakpoints of one instrument.

    ``grip_point_m`` is the middle of the jaws, ``grip_offset_m`` beyond J on the shaft's axis. A surgeon steers that
    point, and with the port it fixes J.
    """

    time_s: tuple[float, ...]
    grip_point_m: tuple[Vector3, ...]
    jaw_angle_rad: tuple[float, ...]
    roll_rad: tuple[float, ...]
    grip_offset_m: float = 10e-3

    def __post_init__(self) -> None:
        n = len(self.time_s)
        if not len(self.grip_point_m) == len(self.jaw_angle_rad) == len(self.roll_rad) == n:
            raise ValueError("a motion needs a grip point, a jaw angle and a roll for each of its times")
        if any(b <= a for a, b in zip(self.time_s[:-1], self.time_s[1:], strict=True)):
            raise ValueError("the times of a motion must increase")


@dataclass(frozen=True, slots=True)
class PlayedScene:
    """A scene and what both hands do in it; a tool without motion stays absent."""

    name: str
    what: str
    duration_s: float
    scene: SceneModel
    motions: tuple[ToolMotion | None, ToolMotion | None]

    def write_inputs(self, time_s: float, out: ToolInputs) -> None:
        """Write the state of both hands at ``time_s`` into ``out``; grasps are left to the simulation."""
        for tool in range(N_TOOLS):
            motion = self.motions[tool]
            out.present[tool] = motion is not None
            if motion is not None:
                _write_tool(motion, self.scene.forceps[tool], time_s, tool, out)


def _write_tool(motion: ToolMotion, forceps: ToolScene, time_s: float, tool: int, out: ToolInputs) -> None:
    table = np.column_stack([np.array(motion.grip_point_m), motion.jaw_angle_rad, motion.roll_rad])
    value, rate = np.empty((2, table.shape[1]))
    minimum_jerk(np.array(motion.time_s), table, time_s, value, rate)
    arm = value[:3] - np.array(forceps.port_position_m)
    out.position_m[tool] = value[:3] - motion.grip_offset_m * (arm / float(np.linalg.norm(arm)))
    out.jaw_angle_rad[tool], out.roll_rad[tool] = value[3], value[4]


def insertion_scene() -> SceneModel:
    """Scene of the insertion: a duct with a wall of 1 mm and 300 kPa, and a 5 Fr catheter of 24 N mm^2.

    The catheter comes out of its introducer towards the mouth, 6 mm short of it and a little off its axis.
    """
    return SceneModel(
        duct=DuctScene(radius_m=4e-3, thickness_m=1e-3, youngs_modulus_pa=300e3, n_around=20, n_along=26, n_modes=80),
        catheter=CatheterScene(
            tip_position_m=(46e-3, 1.5e-3, 0.0),
            introducer_to_tip_m=65e-3,
            introducer_length_m=25e-3,
            introducer_seal_friction_n=20e-3,
        ),
        forceps=(
            ForcepsScene(port_position_m=(75e-3, -60e-3, 120e-3)),
            ForcepsScene(port_position_m=(10e-3, 70e-3, 110e-3), jaw_max_angle_rad=1.2),
        ),
        effects={"gravity": GravitySettings(), "friction": FrictionSettings(), "grasp_slip": NoSettings()},
    )


def insertion() -> PlayedScene:
    """Grasp the catheter 26 mm behind its tip, steady the duct, find the mouth, slide 20 mm in."""
    return PlayedScene(
        name="insertion",
        what="one forceps steadies the duct, the other slides the catheter 20 mm into it",
        duration_s=2.2,
        scene=insertion_scene(),
        motions=(
            ToolMotion(
                time_s=(0.0, 0.25, 0.5, 0.8, 1.0, 1.9),
                grip_point_m=(
                    (72e-3, 1.5e-3, 12e-3),
                    (72e-3, 1.5e-3, 0.0),
                    (72e-3, 1.5e-3, 0.0),
                    (68e-3, 0.0, 0.0),
                    (66e-3, 0.0, 0.0),
                    (44.5e-3, 0.0, 0.0),
                ),
                jaw_angle_rad=(0.7, 0.7, 0.25, 0.25, 0.25, 0.25),
                roll_rad=(0.5 * math.pi,) * 6,
            ),
            _steadying_hand(),
        ),
    )


def _steadying_hand() -> ToolMotion:
    """Close gently round the duct, 10 mm from its mouth."""
    return ToolMotion(
        time_s=(0.0, 0.3, 0.6),
        grip_point_m=((28e-3, 0.0, 15e-3), (28e-3, 0.0, 0.0), (28e-3, 0.0, 0.0)),
        jaw_angle_rad=(1.15, 1.15, 0.8),
        roll_rad=(0.5 * math.pi,) * 3,
        grip_offset_m=12e-3,
    )


def miss() -> PlayedScene:
    """Aim the catheter beside the mouth, at 70 degrees at the outside of the duct, and push.

    The tip finds the wall from outside, sticks by friction, and the free length buckles.
    """
    scene = insertion_scene()
    catheter = replace(
        scene.catheter,
        n_segments=65,
        length_m=0.13,
        youngs_modulus_pa=8e6,
        tip_position_m=(30e-3, 11e-3, 0.0),  # near the steadied place: 0.8 mm to either side it still holds
        introducer_length_m=50e-3,
        direction=(-math.cos(AIM_RAD), -math.sin(AIM_RAD), 0.0),
    )
    grips = [_behind(catheter, 40e-3, 12e-3), *(_behind(catheter, back, 0.0) for back in (40e-3, 40e-3, 34e-3, 20e-3))]
    return PlayedScene(
        name="miss",
        what="the catheter is aimed beside the mouth, pushes on the outside of the duct and buckles",
        duration_s=2.0,
        scene=replace(
            scene,
            catheter=catheter,
            effects={"friction": FrictionSettings(mu_static=0.5, mu_kinetic=0.4), "grasp_slip": NoSettings()},
        ),
        motions=(
            ToolMotion(
                time_s=(0.0, 0.25, 0.5, 1.0, 1.8),
                grip_point_m=tuple(grips),
                jaw_angle_rad=(0.7, 0.7, 0.2, 0.2, 0.2),
                roll_rad=(0.5 * math.pi + AIM_RAD,) * 5,
            ),
            _steadying_hand(),
        ),
    )


AIM_RAD = math.radians(70.0)


def _behind(catheter: CatheterScene, back_m: float, above_m: float) -> Vector3:
    """A point of the catheter's starting line, ``back_m`` behind its tip."""
    x, y, z = (tip - back_m * d for tip, d in zip(catheter.tip_position_m, catheter.direction, strict=True))
    return x, y, z + above_m


SCENARIOS = {"insertion": insertion, "miss": miss}
