"""How deep the bodies of a simulation are in each other, as they are drawn at the end of a step."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.bodies.forceps.kinematics import tool_frame, tool_segments
from trocar.services.mechanics.bodies.forceps.tool_body import ToolBody
from trocar.services.mechanics.collision.pairs import JAW_A, JAW_B, SHAFT
from trocar.services.mechanics.effects.gallstones import Gallstones
from trocar.services.mechanics.effects.self_contact import SelfContactSettings
from trocar.services.mechanics.simulation import Simulation
from trocar.studies.judge.closest import count_layers, nearest_segments, nearest_strands, nearest_triangles

BODIES = ("catheter", "particles", "strands", "stones", "shaft", "jaws", "tool in catheter")
"""What is told apart: the catheter's segments as capsules, its particles alone as spheres, the catheter in itself where
a scene lets it touch itself, stones in wall and catheter, both parts of a tool in the wall."""
OF_TOOLS = BODIES[4:]
IN_CATHETER = "strands", "tool in catheter"
"""What lies in the catheter; all else lies in the wall, or stones in either."""

AT_THE_RIM = np.array([-0.01, 0.01, -0.02, 0.02, -0.03, 0.03, -0.04, 0.04, -0.05, 0.05])
"""Of the jaws' length, the nearest first: jaws of 15 mm that open by 0.3 rad have 45 um more room at each."""

Depths = dict[str, float]
"""By name of `BODIES`, in m; zero where nothing overlaps."""


class OverlapJudge:
    """Measures overlaps with the wall, which is all points within half its thickness of its middle surface.

    Jaws that squeeze the wall leave it as much room as there is between them, shared by the layers that the line
    between their middles passes through: what they have squeezed away is no overlap.

    Args:
        simulation: Simulation

    Attributes:
        deepest: Depths. Of all looks so far.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._triangles = np.ascontiguousarray(simulation.duct.reduced.mesh.triangles, np.int32)
        self._half_m = 0.5 * simulation.scene.duct.thickness_m
        self._apart = _segments_apart(simulation)
        self._segments = np.zeros_like(simulation.tools.segments)
        self.deepest: Depths = dict.fromkeys(BODIES, 0.0)

    def look(self) -> Depths:
        """Return the depths now, and keep the deepest."""
        wall_m = np.ascontiguousarray(self._simulation.duct.surface_m())
        depths = {**self._catheter(wall_m), **self._stones(wall_m), **self._tools(wall_m)}
        for name, depth_m in depths.items():
            self.deepest[name] = max(self.deepest[name], depth_m)
        return depths

    def _catheter(self, wall_m: FloatArray) -> Depths:
        catheter = self._simulation.catheter
        line_m, reach_m = catheter.state.position_m, catheter.radii_m + self._half_m  # of the segment that follows
        segments = np.stack([line_m[:-1], line_m[1:]], axis=1)
        points = np.stack([line_m, line_m], axis=1)
        strands_m = nearest_strands(line_m, self._apart) if self._apart else math.inf
        return {
            "catheter": float(self._depths(segments, reach_m[:-1], wall_m).max()),
            "particles": float(self._depths(points, reach_m, wall_m).max()),
            "strands": max(2.0 * catheter.radius_m - strands_m, 0.0),
        }

    def _depths(self, ends_m: FloatArray, reach_m: float | FloatArray, wall_m: FloatArray) -> FloatArray:
        reach = np.full(len(ends_m), reach_m)
        near = np.empty((len(ends_m), 3))
        nearest_triangles(np.ascontiguousarray(ends_m), reach, wall_m, self._triangles, near)
        depths: FloatArray = reach - near[:, 0]
        return depths

    def _stones(self, wall_m: FloatArray) -> Depths:
        """A stone is a sphere, in the wall or in the catheter."""
        stones = self._simulation.effects.get("gallstones")
        if not isinstance(stones, Gallstones):
            return {"stones": 0.0}
        points, catheter = np.stack([stones.position_m] * 2, axis=1), self._simulation.catheter
        apart_m = np.empty(len(points))
        nearest_segments(points, catheter.state.position_m, apart_m)
        in_catheter_m = stones.radius_m + catheter.radius_m - apart_m
        in_wall_m = self._depths(points, stones.radius_m + self._half_m, wall_m)
        return {"stones": float(np.concatenate([in_catheter_m, in_wall_m]).max(initial=0.0))}

    def _tools(self, wall_m: FloatArray) -> Depths:
        found = dict.fromkeys(OF_TOOLS, 0.0)
        pose_tools(self._simulation.tools, self._segments)
        for segment, depth_m, in_catheter_m in self._tool_overlaps(wall_m):
            name = "shaft" if segment == SHAFT else "jaws"
            found[name] = max(found[name], depth_m)
            found["tool in catheter"] = max(found["tool in catheter"], in_catheter_m)
        return found

    def _tool_overlaps(self, wall_m: FloatArray) -> Iterator[tuple[int, float, float]]:
        """Yield segment, how deep it is in the wall, and in the catheter."""
        tools, catheter = self._simulation.tools, self._simulation.catheter
        for tool in map(int, np.flatnonzero(tools.present & ~tools.disengaged)):
            for segment in np.flatnonzero(tools.radius_m[tool] > 0.0):
                ends, radius_m = self._segments[tool, segment], float(tools.radius_m[tool, segment])
                near, apart = np.empty((1, 3)), np.empty(1)
                reach = np.array([radius_m + self._half_m])
                nearest_triangles(ends[None], reach, wall_m, self._triangles, near)
                nearest_segments(ends[None], catheter.state.position_m, apart)
                squeezed_m = self._squeezed_m(tool, float(near[0, 1]), wall_m) if segment != SHAFT else 0.0
                depth_m = max(float(reach[0] - near[0, 0]) - squeezed_m, 0.0)
                yield int(segment), depth_m, max(radius_m + catheter.radius_m - float(apart[0]), 0.0)

    def _squeezed_m(self, tool: int, where: float, wall_m: FloatArray) -> float:
        """Return how much thinner half a layer is between the jaws, at a place along them (0 to 1).

        What is nearest at the wall's rim lies just beyond it along jaws that open: there the next place inwards counts.
        """
        jaws = self._segments[tool, [JAW_A, JAW_B]]
        for place in (where, *(np.clip(where + AT_THE_RIM, 0.0, 1.0))):
            first, second = (1.0 - place) * jaws[:, 0] + place * jaws[:, 1]
            layers = count_layers(first, second, wall_m, self._triangles)
            if layers:
                room_m = float(np.linalg.norm(second - first) - self._simulation.tools.radius_m[tool, JAW_A:].sum())
                return max(self._half_m - 0.5 * max(room_m, 0.0) / layers, 0.0)
        return 0.0


def pose_tools(tools: ToolBody, out: FloatArray) -> None:
    """Write where shafts and jaws (2, 3, 2, 3) are at the end of the step: the body's own poses are of its start."""
    frame = np.empty((3, 3))
    for tool, forceps in enumerate(tools.forceps):
        junction_m, opening_rad = tools.proxy[tool, :3], float(tools.proxy[tool, 3])
        tool_frame(junction_m, tools.port_m[tool], float(tools.roll_rad[tool]), frame)
        start_m = tools.port_m[tool] if forceps.touches_along_shaft else junction_m
        jaw_m = forceps.jaws.jaw_length_m if forceps.jaws else 0.0
        tool_segments(junction_m, start_m, frame, opening_rad, jaw_m, out[tool])


def _segments_apart(simulation: Simulation) -> int:
    """From how many segments apart the catheter touches itself; 0 where the scene does not let it."""
    settings, catheter = simulation.scene.effects.get("self_contact"), simulation.catheter
    if not isinstance(settings, SelfContactSettings):
        return 0
    apart_m = settings.neighbour_diameters * 2.0 * catheter.radius_m
    return max(math.ceil(apart_m / catheter.properties.segment_length_m), 2) + 1
