"""What simulated hands do in a scene, found from its own geometry: where the mouth is, and which way in is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.effects.friction import FrictionSettings
from trocar.services.mechanics.scenarios import PlayedScene, ToolMotion
from trocar.services.mechanics.scene import ForcepsScene, SceneModel, ToolScene
from trocar.services.mechanics.scene.tools import N_TOOLS
from trocar.services.mechanics.surface.incision import INCISION, gap_middle_m
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.opening import Opening, mouth_opening
from trocar.services.scenes.driving_hands import driving_hands

# Assumptions of how unhurried hands move in the default scene, m, rad and s:
GRIP_BEHIND_TIP_M = 26e-3
"""The catheter is taken so far behind its tip: less and the jaws reach the mouth, more and it buckles."""
ABOVE_M = 12e-3
SHORT_OF_MOUTH_M = 1e-3
INSERTED_M = 20e-3
THROUGH_CUT_M = 13e-3
"""So far is the catheter pushed through a cut: farther, and the jaws meet the wall before it."""
STEADY_BEYOND_MOUTH_M = 12e-3
JAW_REACH_M = 10e-3, 12e-3
"""Beyond the junction, where the two tools hold: the catheter, the duct at least."""
BEYOND_GRIP_M = 3e-3
"""So much of the jaws lies beyond what they hold."""
TO_SPARE = 1.1
"""So much farther in their jaws than friction just holds it is the duct taken."""
SQUEEZE_M = 0.8e-3
"""By how much jaws that close round the duct press into it, from either side."""
PINCH_M = 2.5e-3
PRESS_M = 2e-3
AWAY_M = 50e-3
"""From the mouth, where a tool that has nothing to do waits."""
STROKE_M = 4e-3
_OPEN_RAD, _HELD_RAD = 0.7, 0.25
_INSERTION_S = 0.0, 0.25, 0.5, 0.8, 1.0, 1.9
_CLOSING_S = 0.0, 0.3, 0.6
_STROKE_S = 0.3, 0.5, 0.16, 0.56
"""Rest, back, rest, forth."""


def hands_of(scene: SceneModel, mesh: TriangleMesh) -> PlayedScene:
    """Return what both hands do: what the scene's ``hands`` names.

    Args:
        scene: SceneModel. With its catheter where it starts: see `place_catheter`.
        mesh: TriangleMesh. The duct, with the vertex set ``mouth``.
    """
    mouth = mouth_opening(mesh)
    makers = {"insertion": _insertion, "pinch": _pinch, "press": _press, "drive": _drive, "none": _nothing}
    return makers[scene.hands if scene.forceps else "none"](scene, mesh, mouth)


def _nothing(scene: SceneModel, mesh: TriangleMesh, mouth: Opening) -> PlayedScene:
    return PlayedScene("none", "no hand is there", 1.0, scene, (None, None))


def _insertion(scene: SceneModel, mesh: TriangleMesh, mouth: Opening) -> PlayedScene:
    return PlayedScene(
        name="insertion",
        what="one forceps steadies the duct, the other brings the catheter before the mouth and slides it in",
        duration_s=2.2,
        scene=scene,
        motions=(_inserting_hand(scene, _entry(scene, mesh, mouth)), _steadying_hand(scene, mesh, mouth)),
    )


def _drive(scene: SceneModel, mesh: TriangleMesh, mouth: Opening) -> PlayedScene:
    first, second = (*driving_hands(scene, mesh), None)[:N_TOOLS]
    return PlayedScene(
        name="drive",
        what=f"a drive pushes, twists and steers the catheter to {scene.target}",
        duration_s=max(hand.time_s[-1] for hand in (first, second) if hand is not None) + 0.5,
        scene=scene,
        motions=(first, second),
    )


def _steadying_hand(scene: SceneModel, mesh: TriangleMesh, mouth: Opening) -> ToolMotion | None:
    """Hold the duct with the second tool, if there is one, so far in its jaws that it does not slip."""
    return _closing_hand(scene, 1, mesh, mouth, SQUEEZE_M, holds=True) if len(scene.forceps) > 1 else None


def _pinch(scene: SceneModel, mesh: TriangleMesh, mouth: Opening) -> PlayedScene:
    hand = _closing_hand(scene, _last_tool(scene), mesh, mouth, PINCH_M)
    return _by_last_tool(scene, "pinch", "one forceps closes round the duct and presses it together", hand)


def _press(scene: SceneModel, mesh: TriangleMesh, mouth: Opening) -> PlayedScene:
    hand = _pressing_hand(scene, _last_tool(scene), mesh, mouth)
    return _by_last_tool(scene, "press", "the tip of one tool touches the duct from outside and presses on it", hand)


def _last_tool(scene: SceneModel) -> int:
    """Return the only one, or the second."""
    return len(scene.forceps) - 1


def _by_last_tool(scene: SceneModel, name: str, what: str, hand: ToolMotion | None) -> PlayedScene:
    motions = (None, hand) if _last_tool(scene) else (hand, None)
    return PlayedScene(name=name, what=what, duration_s=1.2, scene=scene, motions=motions)


def _pressing_hand(scene: SceneModel, at: int, mesh: TriangleMesh, mouth: Opening) -> ToolMotion:
    """Go down on the duct behind its mouth with a tool that is shut, from the side on which its port is."""
    tool, section = scene.forceps[at], _section(mesh, mouth)
    beyond_m, radius_m = (tool.jaws.jaw_length_m, tool.jaws.jaw_radius_m) if tool.jaws else (0.0, tool.body_radius_m)
    outward = _towards_port(tool, section.centre_m)
    outward = outward - float(outward @ mouth.inward) * mouth.inward
    outward /= float(np.linalg.norm(outward))
    out_m = section.radius_m + 0.5 * scene.duct.thickness_m + radius_m
    points = [section.centre_m + (out_m + way_m) * outward for way_m in (ABOVE_M, 1e-3, -PRESS_M)]
    return ToolMotion(
        time_s=_CLOSING_S,
        grip_point_m=tuple(_tuple(point) for point in points),
        jaw_angle_rad=(0.0,) * 3,
        roll_rad=(0.0,) * 3,
        grip_offset_m=beyond_m,
    )


def _entry(scene: SceneModel, mesh: TriangleMesh, mouth: Opening) -> Opening:
    """Return the opening that the catheter goes in by; into a cut it goes as it lies, in the middle of the gap."""
    if scene.catheter.opening != INCISION:
        return mouth
    along = np.array(scene.catheter.direction) / float(np.linalg.norm(scene.catheter.direction))
    return Opening(gap_middle_m(mesh), along, mouth.radius_m)


def _inserting_hand(scene: SceneModel, mouth: Opening) -> ToolMotion:
    """Take the catheter behind its tip, bring the tip before the mouth's middle, and push along the mouth's axis."""
    forceps, catheter = scene.forceps[0], scene.catheter
    along = np.array(catheter.direction) / float(np.linalg.norm(catheter.direction))
    taken = np.array(catheter.tip_position_m) - GRIP_BEHIND_TIP_M * along
    aimed = mouth.centre_m - (GRIP_BEHIND_TIP_M + SHORT_OF_MOUTH_M) * mouth.inward
    begun = aimed + (SHORT_OF_MOUTH_M + 1e-3) * mouth.inward
    inserted_m = INSERTED_M if catheter.opening != INCISION else THROUGH_CUT_M
    pushed = begun + (inserted_m + 0.5e-3) * mouth.inward
    above = taken + ABOVE_M * _towards_port(forceps, taken)
    points = (above, taken, taken, aimed, begun, pushed)
    return ToolMotion(
        time_s=_INSERTION_S,
        grip_point_m=tuple(_tuple(point) for point in points),
        jaw_angle_rad=(_OPEN_RAD, _OPEN_RAD, *(_HELD_RAD,) * 4),
        roll_rad=tuple(roll_across(forceps, point, along if k < 3 else mouth.inward) for k, point in enumerate(points)),
        grip_offset_m=JAW_REACH_M[0],
    )


def _closing_hand(
    scene: SceneModel, tool: int, mesh: TriangleMesh, mouth: Opening, squeeze_m: float, *, holds: bool = False
) -> ToolMotion | None:
    """Close round the duct behind its mouth; nobody where it is wider than the jaws open, or there are none.

    ``holds`` is whether it shall not slip in them, as far as they are long enough.
    """
    forceps, section = scene.forceps[tool].jaws, _section(mesh, mouth)
    if forceps is None:
        return None
    half_m = section.radius_m + 0.5 * scene.duct.thickness_m + forceps.jaw_radius_m
    reach_m = holding_reach_m(scene, forceps, half_m) if holds else JAW_REACH_M[1]
    wide_rad, shut_rad = (2.0 * math.asin(min(gap / reach_m, 1.0)) for gap in (half_m + 1e-3, half_m - squeeze_m))
    if wide_rad > forceps.jaw_max_angle_rad:
        return None
    above = section.centre_m + (half_m + ABOVE_M) * _towards_port(forceps, section.centre_m)
    points = (above, section.centre_m, section.centre_m)
    return ToolMotion(
        time_s=_CLOSING_S,
        grip_point_m=tuple(_tuple(point) for point in points),
        jaw_angle_rad=(wide_rad, wide_rad, shut_rad),
        roll_rad=tuple(roll_across(forceps, point, mouth.inward) for point in points),
        grip_offset_m=reach_m,
    )


def holding_reach_m(scene: SceneModel, jaws: ForcepsScene, half_m: float) -> float:
    """Return how far beyond their hinge jaws take a duct that their axes touch at ``half_m`` from its middle.

    Jaws at an angle a to the tool's axis push what they close on out towards their tips, and their friction holds it
    where tan a is less than its coefficient. So far in that even one that slides is held, from the first touch on, with
    something to spare; jaws that are too short take it as near to their tips as they can.
    """
    friction = scene.effects.get("friction")
    mu = friction.tool_mu_kinetic if isinstance(friction, FrictionSettings) else 0.0
    wanted_m = TO_SPARE * half_m * math.hypot(1.0, 1.0 / mu) if mu > 0.0 else 0.0
    return max(min(wanted_m, jaws.jaw_length_m - BEYOND_GRIP_M), JAW_REACH_M[1])


def with_strokes(scenario: PlayedScene, n: int) -> PlayedScene:
    """Return a scenario whose last motion is taken back and made again, ``n`` times.

    Of the hand that comes to rest last, as that is the one which does what the scene is for; a hand that has been
    moving goes back by `STROKE_M`, one that only closed its jaws opens them again.
    """
    ends = [motion.time_s[-1] if motion is not None else -1.0 for motion in scenario.motions]
    hand = int(np.argmax(ends))
    motions = [_with_strokes(motion, n) if motion is not None and k == hand else motion
               for k, motion in enumerate(scenario.motions)]  # fmt: skip
    return replace(scenario, motions=(motions[0], motions[1]), duration_s=scenario.duration_s + n * sum(_STROKE_S))


def _with_strokes(motion: ToolMotion, n: int) -> ToolMotion:
    table = np.column_stack([np.array(motion.grip_point_m), motion.jaw_angle_rad, motion.roll_rad])
    last = table[-1]
    moved_m = float(np.linalg.norm((last - table[-2])[:3]))
    back = last + min(1.0, STROKE_M / moved_m if moved_m > 0.0 else 1.0) * (table[-2] - last)
    rows = np.vstack([table, np.tile([last, back, back, last], (n, 1))])
    times = (*motion.time_s, *(motion.time_s[-1] + np.cumsum(np.tile(_STROKE_S, n))).tolist())
    return replace(
        motion,
        time_s=times,
        grip_point_m=tuple(_tuple(row) for row in rows[:, :3]),
        jaw_angle_rad=tuple(rows[:, 3].tolist()),
        roll_rad=tuple(rows[:, 4].tolist()),
    )


def out_of_the_way(scene: SceneModel, tool: int, mesh: TriangleMesh) -> ToolMotion:
    """Return what a tool that has nothing to do does where it cannot be absent: it waits shut, near its port."""
    mouth = mouth_opening(mesh)
    forceps = scene.forceps[tool]
    waits = mouth.centre_m + AWAY_M * _towards_port(forceps, mouth.centre_m)
    return ToolMotion((0.0,), (_tuple(waits),), (0.0,), (0.0,))


@dataclass(frozen=True, slots=True)
class _Section:
    centre_m: FloatArray
    radius_m: float


def _section(mesh: TriangleMesh, mouth: Opening) -> _Section:
    """Return middle and largest radius of the duct a little behind its mouth, where it goes on from there.

    Of a mesh so coarse, or a duct so short, that no vertex lies there, those that lie nearest.
    """
    away = mesh.vertices_m - mouth.centre_m
    depth = away @ mouth.inward
    across = np.linalg.norm(away - depth[:, None] * mouth.inward, axis=1)
    off = np.where(across < 3.0 * mouth.radius_m, np.abs(depth - STEADY_BEYOND_MOUTH_M), np.inf)
    nearest_m = float(off.min())
    ring = mesh.vertices_m[off < (2e-3 if nearest_m < 2e-3 else nearest_m + 2e-3)]
    centre = ring.mean(axis=0)
    out = ring - centre
    out -= (out @ mouth.inward)[:, None] * mouth.inward
    return _Section(centre, float(np.linalg.norm(out, axis=1).max()))


def roll_across(forceps: ToolScene, point_m: FloatArray, along: FloatArray) -> float:
    """Return the roll, within half a turn, at which jaws round ``point_m`` (3,) close across the direction (3,)."""
    shaft = -_towards_port(forceps, point_m)
    x, y, z = shaft
    k = 1.0 / max(1.0 - z, 1e-9)
    # The tool's axes at roll 0: `kinematics.tool_frame`.
    first, second = np.array([1.0 - k * x * x, -k * x * y, x]), np.array([-k * x * y, 1.0 - k * y * y, y])
    across = np.cross(shaft, along)
    roll = math.atan2(float(across @ second), float(across @ first))
    return roll % math.pi


def _towards_port(forceps: ToolScene, point_m: FloatArray) -> FloatArray:
    arm = np.array(forceps.port_position_m) - point_m
    direction: FloatArray = arm / float(np.linalg.norm(arm))
    return direction


def _tuple(point_m: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point_m)
    return x, y, z
