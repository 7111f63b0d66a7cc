"""What a simulated hand does with a drive: it finds from the geometry where to turn, to bend and to push on."""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.rod.elasticity import any_normal
from trocar.services.mechanics.scenarios import ToolMotion
from trocar.services.mechanics.scene import SceneModel, ToolScene
from trocar.services.mechanics.surface.centreline import centrelines
from trocar.services.mechanics.surface.mesh import TriangleMesh
from trocar.services.mechanics.surface.opening import mouth_opening
from trocar.services.meshes.tube_paths import TubePaths
from trocar.services.runtime.errors import ConfigError

PUSH_M_S, ROLL_RAD_S, BEND_RAD_S = 20e-3, 2.0, 1.5  # assumptions: an unhurried hand
BEFORE_RADII, BEYOND_RADII, SHORT_RADII = 2.5, 1.0, 2.6
"""Of the mouth: so far before ways part the tip is turned and bent, so far beyond it is let go, and so far short of its
end the way is gone."""
_PAUSE_S = 0.2  # assumption: about a person's time to react, in which a bent tip comes to rest
_STRAIGHT = 1e-9  # of unit vectors: far beyond their rounding, far below any bend
_CHANGE = "lead", "catheter", "handle", "roll"
_EDGES = 8
"""Of a way along which a director is carried: few, as more would follow the wiggles of a centreline."""


def driving_hands(scene: SceneModel, mesh: TriangleMesh) -> list[ToolMotion | None]:
    """Return for each tool how drives bring the tip to the scene's target: a guide wire's if there is one.

    Before each place where another way parts it rolls until the tip bends to the side on which the target's way goes
    on, bends it by the handle where that steers it, and pushes past. A catheter leads its wire in, then follows.
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
    return [plan.wires(tool) if tool.drives_wire else plan.catheters(tool) for tool in scene.forceps]


class _Plan:
    """Breakpoints of the drives, one after the other: what leads is the wire, or else the catheter itself."""

    def __init__(self, scene: SceneModel, before_m: float) -> None:
        catheter = scene.catheter
        self._along = np.array(catheter.direction) / float(np.linalg.norm(catheter.direction))
        self._end_m = np.array(catheter.tip_position_m) - catheter.length_m * self._along
        self._handle_rad = _handle_rad(scene)
        self._wire = wire = catheter.guide_wire
        self._out_m, self._stride_m = (wire.out_m, wire.reach_m - wire.out_m) if wire is not None else (0.0, 0.0)
        # Time, how deep what leads and the catheter are, handle, roll of what leads.
        self._rows = [(0.0, self._out_m - before_m, -before_m, 0.0, 0.0)]
        self._add(_PAUSE_S)
        if wire is not None:
            self._add(before_m / PUSH_M_S, lead=self._out_m, catheter=0.0)

    def _add(self, seconds: float, **changes: float) -> None:
        time_s, *last = self._rows[-1]
        depth_m, catheter_m, handle_rad, roll_rad = (
            changes.get(name, value) for name, value in zip(_CHANGE, last, strict=True)
        )
        self._rows.append((time_s + max(seconds, _PAUSE_S), depth_m, catheter_m, handle_rad, roll_rad))

    def push(self, depth_m: float) -> None:
        """Push until the tip is so deep, if it is not; a wire in strides, after each of which the catheter follows."""
        while (way_m := depth_m - self._rows[-1][1]) > 0.0:
            way_m = min(way_m, self._stride_m or way_m)
            deeper_m = self._rows[-1][1] + way_m
            if self._stride_m:
                self._add(way_m / PUSH_M_S, lead=deeper_m)
            self._add(way_m / PUSH_M_S, lead=deeper_m, catheter=deeper_m - self._out_m)

    def turn(self, depth_m: float, roll_rad: float) -> None:
        """Push so far, then roll to this angle by the shorter way."""
        self.push(depth_m)
        was_rad = self._rows[-1][4]
        change_rad = math.remainder(roll_rad - was_rad, 2.0 * math.pi)
        self._add(abs(change_rad) / ROLL_RAD_S, roll=was_rad + change_rad)

    def bend(self, *, bent: bool) -> None:
        """Turn the handle, or let it go; nothing where it steers nothing."""
        if self._handle_rad:
            self._add(self._handle_rad / BEND_RAD_S, handle=self._handle_rad if bent else 0.0)

    def catheters(self, tool: ToolScene) -> ToolMotion | None:
        """Return what a drive of the catheter does: J is where its proximal end is."""
        if not tool.drives_catheter:
            return None
        return self._motion(2, self._end_m, [(row[3], row[4] if self._wire is None else 0.0) for row in self._rows])

    def wires(self, tool: ToolScene) -> ToolMotion:
        """Return what a drive of the wire does: J begins midway between its port and the catheter's proximal end."""
        middle_m = 0.5 * (self._end_m + np.array(tool.port_position_m))
        return self._motion(1, middle_m, [(0.0, row[4]) for row in self._rows])

    def _motion(self, column: int, begins_m: FloatArray, turns: list[tuple[float, float]]) -> ToolMotion:
        points = [begins_m + (row[column] - self._rows[0][column]) * self._along for row in self._rows]
        return ToolMotion(
            time_s=tuple(row[0] for row in self._rows),
            grip_point_m=tuple((float(x), float(y), float(z)) for x, y, z in points),
            jaw_angle_rad=tuple(handle_rad for handle_rad, _ in turns),
            roll_rad=tuple(roll_rad for _, roll_rad in turns),
            grip_offset_m=0.0,
        )


def _handle_rad(scene: SceneModel) -> float:
    """Return how far the handle is turned to bend the tip: all its way, none where it steers nothing."""
    steers = scene.catheter.guide_wire is None and any(any(each.steering_1_m_rad) for each in scene.catheter.sections)
    return max(tool.handle_range[1] for tool in scene.forceps) if steers else 0.0


def _bend_axis(scene: SceneModel) -> FloatArray:
    """(2,) curvature about m1 and m2 of the first section of what leads that the handle, or else rest, bends."""
    for name in ("steering_1_m_rad", "rest_curvature_1_m"):
        for section in (scene.catheter.guide_wire or scene.catheter).sections:
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
