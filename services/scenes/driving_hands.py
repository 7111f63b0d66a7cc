"""What a simulated hand does with a drive: it finds from the geometry where to turn, to bend and to push on."""

from __future__ import annotations

import math

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.rod.elasticity import any_normal
from services.mechanics.scenarios import ToolMotion
from services.mechanics.scene import SceneModel
from services.mechanics.surface.centreline import centrelines
from services.mechanics.surface.mesh import TriangleMesh
from services.mechanics.surface.opening import mouth_opening
from services.runtime.errors import ConfigError
from services.tube_paths import TubePaths

PUSH_M_S, ROLL_RAD_S, BEND_RAD_S = 20e-3, 2.0, 1.5
BEFORE_RADII, BEYOND_RADII, SHORT_RADII = 2.5, 1.0, 2.6
"""Of the mouth: so far before ways part the tip is turned and bent, so far beyond it is let go, and so far short of its
end the way is gone."""
_PAUSE_S = 0.2
_STRAIGHT = 1e-9
_EDGES = 8
"""Of a way along which a director is carried: more would follow the wiggles of a centreline."""


def driving_hand(scene: SceneModel, mesh: TriangleMesh) -> ToolMotion:
    """Return how a drive brings the tip to the scene's target.

    Before each place where another way parts it rolls until the tip bends to the side on which the target's way goes
    on, bends it by the handle where that steers it, and pushes past.
    Raises ConfigError if the duct has no end of the target's name.
    """
    ways, mouth = TubePaths(centrelines(mesh)), mouth_opening(mesh)
    if scene.target not in ways.path_m:
        known = ", ".join(ways.path_m) or "none"
        raise ConfigError(f"{scene.source}: target: the duct has no end {scene.target!r}; it has: {known}")
    before_m = float((mouth.centre_m - np.array(scene.catheter.tip_position_m)) @ mouth.inward)
    plan = _Plan(scene, before_m)
    others = {ways.shared_m(scene.target, name): name for name in ways.path_m if name != scene.target}
    for parts_m, other in sorted(others.items()):
        bend_m = max(parts_m - BEFORE_RADII * mouth.radius_m, 0.0)
        past_m = parts_m + BEYOND_RADII * mouth.radius_m
        plan.turn(bend_m, _roll_rad(scene, ways, other, (bend_m, past_m)))
        plan.bend(bent=True)
        plan.push(past_m)
        plan.bend(bent=False)
    plan.push(float(ways.arc_m[scene.target][-1]) - SHORT_RADII * mouth.radius_m)
    return plan.motion()


class _Plan:
    """Breakpoints of the drive, one after the other."""

    def __init__(self, scene: SceneModel, before_m: float) -> None:
        catheter = scene.catheter
        self._along = np.array(catheter.direction) / float(np.linalg.norm(catheter.direction))
        self._end_m = np.array(catheter.tip_position_m) - catheter.length_m * self._along
        self._handle_rad = _handle_rad(scene)
        self._rows = [(0.0, -before_m, 0.0, 0.0)]  # time, how deep the tip is, handle, roll
        self._add(_PAUSE_S)

    def _add(self, seconds: float, **changes: float) -> None:
        time_s, *last = self._rows[-1]
        depth_m, handle_rad, roll_rad = (
            changes.get(name, value) for name, value in zip(("depth", "handle", "roll"), last, strict=True)
        )
        self._rows.append((time_s + max(seconds, _PAUSE_S), depth_m, handle_rad, roll_rad))

    def push(self, depth_m: float) -> None:
        """Push until the tip is so deep, if it is not."""
        way_m = depth_m - self._rows[-1][1]
        if way_m > 0.0:
            self._add(way_m / PUSH_M_S, depth=depth_m)

    def turn(self, depth_m: float, roll_rad: float) -> None:
        """Push so far, then roll to this angle by the shorter way."""
        self.push(depth_m)
        was_rad = self._rows[-1][3]
        change_rad = math.remainder(roll_rad - was_rad, 2.0 * math.pi)
        self._add(abs(change_rad) / ROLL_RAD_S, roll=was_rad + change_rad)

    def bend(self, *, bent: bool) -> None:
        """Turn the handle, or let it go; nothing where it steers nothing."""
        if self._handle_rad:
            self._add(self._handle_rad / BEND_RAD_S, handle=self._handle_rad if bent else 0.0)

    def motion(self) -> ToolMotion:
        """Return it all: J is where the catheter's proximal end is."""
        start_m = self._rows[0][1]
        points = [self._end_m + (row[1] - start_m) * self._along for row in self._rows]
        return ToolMotion(
            time_s=tuple(row[0] for row in self._rows),
            grip_point_m=tuple((float(x), float(y), float(z)) for x, y, z in points),
            jaw_angle_rad=tuple(row[2] for row in self._rows),
            roll_rad=tuple(row[3] for row in self._rows),
            grip_offset_m=0.0,
        )


def _handle_rad(scene: SceneModel) -> float:
    """Return how far the handle is turned to bend the tip: all its way, none where it steers nothing."""
    steers = any(any(section.steering_1_m_rad) for section in scene.catheter.sections)
    return max(tool.handle_range[1] for tool in scene.forceps) if steers else 0.0


def _bend_axis(scene: SceneModel) -> FloatArray:
    """(2,) curvature about m1 and m2 of the first section that the handle, or else rest, bends."""
    for name in ("steering_1_m_rad", "rest_curvature_1_m"):
        for section in scene.catheter.sections:
            if any(getattr(section, name)):
                return np.array(getattr(section, name)[:2])
    return np.array([1.0, 0.0])


def _roll_rad(scene: SceneModel, ways: TubePaths, other: str, span_m: tuple[float, float]) -> float:
    """Return the roll of the drive at which the tip, where a span begins, bends away from another way at its end."""
    points = _points(ways, scene.target, np.linspace(0.0, span_m[0], _EDGES + 1))
    apart_m = _points(ways, scene.target, span_m[1]) - _points(ways, other, span_m[1])
    along = np.array(scene.catheter.direction) / float(np.linalg.norm(scene.catheter.direction))
    m1 = np.array(any_normal((along[0], along[1], along[2])))
    about_1, about_2 = _bend_axis(scene)
    bends = np.cross(about_1 * m1 + about_2 * np.cross(along, m1), along)
    for edge in np.diff(points, axis=0) if span_m[0] > 0.0 else ():
        bends, along = _carried(bends, along, edge / float(np.linalg.norm(edge)))
    wanted = apart_m - float(apart_m @ along) * along
    if float(np.linalg.norm(wanted)) < _STRAIGHT:
        return 0.0
    # Roll turns a tool from e1 to e2 of `tool_frame`, whose cross product is against its own axis.
    return -math.atan2(float(along @ np.cross(bends, wanted)), float(bends @ wanted))


def _points(ways: TubePaths, name: str, at_m: FloatArray | float) -> FloatArray:
    """Return where a way is after lengths (n,): (n, 3), or (3,) after one."""
    return np.stack([np.interp(at_m, ways.arc_m[name], axis) for axis in ways.path_m[name].T], axis=-1)


def _carried(vector: FloatArray, along: FloatArray, onto: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a vector turned as the least rotation turns one direction onto another, and that direction."""
    axis, cosine = np.cross(along, onto), float(along @ onto)
    turned = cosine * vector + np.cross(axis, vector) + float(axis @ vector) / (1.0 + cosine) * axis
    return turned, onto
