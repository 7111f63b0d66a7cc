"""The catheter touching itself where it loops."""

from __future__ import annotations

import math
from dataclasses import dataclass

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.pairs import CATHETER_SEGMENT, NO_TOOL, PairArrays
from services.mechanics.collision.primitives import closest_of_segments
from services.mechanics.compiled import kernel
from services.mechanics.effects.base import Effect, require_positive
from services.mechanics.world import World


@dataclass(frozen=True, slots=True)
class SelfContactSettings:
    """Segments closer along the catheter than this many diameters are not tested against each other."""

    neighbour_diameters: float = 4.0

    def __post_init__(self) -> None:
        require_positive(self, "neighbour_diameters")


class SelfContact(Effect):
    """Contacts between segments of the catheter, solved with all the others.

    The normal is that of the axes' closest points, so a loop may not pass through itself within one tick: a
    diameter a tick, more than 1 m/s.
    """

    Settings = SelfContactSettings

    def prepare(self, world: World) -> None:
        """Turn diameters into segments."""
        properties = world.catheter.properties
        apart_m = self.settings.neighbour_diameters * 2.0 * world.catheter.radius_m
        self._skip = max(2, math.ceil(apart_m / properties.segment_length_m))

    def add_pairs(self, world: World, dt_s: float) -> None:
        """Append pairs of segments within the margin."""
        reach = 2.0 * world.catheter.radius_m + world.scene.contact.margin_m
        position, pairs = world.catheter.start_m, world.pairs
        pairs.count = append_self_pairs(position, self._skip, reach, pairs.arrays, pairs.count)


@kernel
def append_self_pairs(position: FloatArray, skip: int, reach: float, out: PairArrays, count: int) -> int:
    """Append the closest points of segments i and j > i + skip that are within ``reach``; return the new count.

    One pair for each segment i, its closest: a loop that lies along itself still has one a segment.
    """
    n = position.shape[0] - 1
    for i in range(n - skip - 1):
        best, s_best, t_best, target = reach * reach, 0.0, 0.0, -1
        a = (position[i, 0], position[i, 1], position[i, 2])
        b = (position[i + 1, 0], position[i + 1, 1], position[i + 1, 2])
        for j in range(i + skip + 1, n):
            c = (position[j, 0], position[j, 1], position[j, 2])
            d = (position[j + 1, 0], position[j + 1, 1], position[j + 1, 2])
            s, t, distance_2 = closest_of_segments(a, b, c, d)
            if 0.0 < distance_2 < best:
                best, s_best, t_best, target = distance_2, s, t, j
        if target < 0 or count == out.target.shape[0]:
            continue
        distance = math.sqrt(best)
        for axis in range(3):
            first = (1.0 - s_best) * position[i, axis] + s_best * position[i + 1, axis]
            second = (1.0 - t_best) * position[target, axis] + t_best * position[target + 1, axis]
            out.normal[count, axis] = (first - second) / distance
        out.tool[count], out.tool_segment[count] = NO_TOOL, 0
        out.particle[count], out.tool_parameter[count] = i, s_best
        out.target_kind[count], out.target[count] = CATHETER_SEGMENT, target
        out.target_weights[count, 0], out.target_weights[count, 1] = 1.0 - t_best, t_best
        out.target_weights[count, 2] = 0.0
        count += 1
    return count
