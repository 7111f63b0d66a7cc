"""How deep the bodies of a simulation are in each other, as they are drawn at the end of a step."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.simulation import Simulation
from studies.judge.closest import count_layers, nearest_segments, nearest_triangles

SHAFT, JAW_A, JAW_B = range(3)
BODIES = ("catheter", "particles", "shaft", "jaws", "tool in catheter")
"""What is told apart: the catheter's segments as capsules, its particles alone as spheres, both parts of a tool."""

Depths = dict[str, float]
"""By name of `BODIES`, in m; zero where nothing overlaps."""


class OverlapJudge:
    """Measures overlaps with the wall, which is all points within half its thickness of its middle surface.

    Jaws that squeeze the wall leave it as much room as there is between them, shared by the layers that the line
    between their middles passes through: what they have squeezed away is no overlap.

    Parameters
    ----------
    simulation : Simulation

    Attributes
    ----------
    deepest : Depths
        Of all looks so far.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._triangles = np.ascontiguousarray(simulation.duct.reduced.mesh.triangles, np.int32)
        self._half_m = 0.5 * simulation.scene.duct.thickness_m
        self.deepest: Depths = dict.fromkeys(BODIES, 0.0)

    def look(self) -> Depths:
        """Return the depths now, and keep the deepest."""
        wall_m = np.ascontiguousarray(self._simulation.duct.surface_m())
        depths = {**self._catheter(wall_m), **self._tools(wall_m)}
        for name, depth_m in depths.items():
            self.deepest[name] = max(self.deepest[name], depth_m)
        return depths

    def _catheter(self, wall_m: FloatArray) -> Depths:
        catheter = self._simulation.catheter
        line_m, reach_m = catheter.state.position_m, catheter.radius_m + self._half_m
        segments = np.stack([line_m[:-1], line_m[1:]], axis=1)
        points = np.stack([line_m, line_m], axis=1)
        return {
            "catheter": float(self._depths(segments, reach_m, wall_m).max()),
            "particles": float(self._depths(points, reach_m, wall_m).max()),
        }

    def _depths(self, ends_m: FloatArray, reach_m: float, wall_m: FloatArray) -> FloatArray:
        reach = np.full(len(ends_m), reach_m)
        near = np.empty((len(ends_m), 3))
        nearest_triangles(np.ascontiguousarray(ends_m), reach, wall_m, self._triangles, near)
        depths: FloatArray = reach - near[:, 0]
        return depths

    def _tools(self, wall_m: FloatArray) -> Depths:
        found = dict.fromkeys(("shaft", "jaws", "tool in catheter"), 0.0)
        for tool, segment, depth_m, in_catheter_m in self._tool_overlaps(wall_m):
            name = "shaft" if segment == SHAFT else "jaws"
            found[name] = max(found[name], depth_m)
            if not self._simulation.tools.held[tool, 1]:  # jaws that hold the catheter have it between them
                found["tool in catheter"] = max(found["tool in catheter"], in_catheter_m)
        return found

    def _tool_overlaps(self, wall_m: FloatArray) -> Iterator[tuple[int, int, float, float]]:
        """Yield tool, segment, how deep it is in the wall, and in the catheter."""
        tools, catheter = self._simulation.tools, self._simulation.catheter
        for tool in map(int, np.flatnonzero(tools.present & ~tools.waiting)):
            for segment in np.flatnonzero(tools.radius_m[tool] > 0.0):
                ends, radius_m = tools.segments[tool, segment], float(tools.radius_m[tool, segment])
                near, apart = np.empty((1, 3)), np.empty(1)
                reach = np.array([radius_m + self._half_m])
                nearest_triangles(ends[None], reach, wall_m, self._triangles, near)
                nearest_segments(ends[None], catheter.state.position_m, apart)
                squeezed_m = self._squeezed_m(tool, float(near[0, 1]), wall_m) if segment != SHAFT else 0.0
                depth_m = max(float(reach[0] - near[0, 0]) - squeezed_m, 0.0)
                yield tool, int(segment), depth_m, max(radius_m + catheter.radius_m - float(apart[0]), 0.0)

    def _squeezed_m(self, tool: int, where: float, wall_m: FloatArray) -> float:
        """Return how much thinner half a layer is between the jaws, at a place along them (0 to 1)."""
        jaws = self._simulation.tools.segments[tool, [JAW_A, JAW_B]]
        first, second = (1.0 - where) * jaws[:, 0] + where * jaws[:, 1]
        layers = count_layers(first, second, wall_m, self._triangles)
        if layers == 0:
            return 0.0
        room_m = float(np.linalg.norm(second - first)) - float(self._simulation.tools.radius_m[tool, JAW_A:].sum())
        return max(self._half_m - 0.5 * max(room_m, 0.0) / layers, 0.0)
