"""Points of the wall that the catheter pressed: they outlive detection, as those that tools press do, see `manifold`.

A wall that turns to and fro about a round catheter is closest elsewhere in every tick. With one point at a time it
rolls over the catheter one way, about that point, and back about the next one: each time it sinks in by what its way
round differs from the plane of the point, which the solve knows nothing of. A kept point belongs to the particle that
pressed it, and is never deeper in it than the closest one: it holds what is pressed and adds no overlap of its own.
Where nothing has come as deep as counts, none is kept: a tick of an insertion costs no more.
"""

from __future__ import annotations

import math

from services.mechanics.arrays import BoolArray, FloatArray, IntArray
from services.mechanics.collision.beside import FACING, apart_m
from services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs, pairs_at
from services.mechanics.collision.writer import FULL, write_pair
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.compiled.vectors import Vector, along, dot, put_row, scaled, squared_distance, subtract
from services.mechanics.compiled.vectors import row as row_of
from services.mechanics.contact import laws
from services.mechanics.contact.geometry import ContactGeometry, RodGeometry, WallGeometry, geometry_at, wall_at
from services.mechanics.contact.identity import target_kind_of, target_of
from services.mechanics.contact.manifold import ONE_POINT, NodePositions, PressedPoints, kept_point, write_corners
from services.mechanics.contact.met import least_approach_m
from services.mechanics.contact.rows import NO_STONE, ContactRows, rows_at
from services.mechanics.contact.system import ContactSystem

# A point may be one with what was found by a particle so many places further.
_BESIDE = 2
NONE = -1


class CatheterManifold(PressedPoints):
    """Points of the wall that the catheter pressed in the last tick."""

    def __init__(self, wall: WallGeometry, margin_m: float) -> None:
        super().__init__(wall, margin_m)
        self._least_m = least_approach_m(wall.half_thickness)

    def keep(self, system: ContactSystem, deepest_m: float) -> None:
        """Remember the pressed points of the rows just solved, where something is as deep as counts or gives anything.

        ``deepest_m`` is the deepest overlap.
        """
        if deepest_m > self._least_m or system.owed_j > 0.0:
            self._keep(system)
        elif self._pairs.count:
            self.forget()

    def _keep(self, system: ContactSystem) -> None:
        states = (system.slides, self._slid, self._nodes)
        keep_pressed_by_catheter(system.rows.address, self._wall.address, self._pairs.address, states)

    def append_to(self, pairs: ContactPairs, wall: NodePositions, geometry: ContactGeometry) -> None:
        """Append those that are still within reach and that ``pairs`` does not have, as far as there is room."""
        if self._pairs.count:
            self._append(pairs, wall, geometry)

    def _append(self, pairs: ContactPairs, wall: NodePositions, geometry: ContactGeometry) -> None:
        states = (self._corners_now(wall), self._slid)
        append_kept(geometry.address, self._pairs.address, states, self._sizes, pairs.address)

    def compile_kernels(self, system: ContactSystem, pairs: ContactPairs, wall: NodePositions) -> None:
        """Keep and append, however shallow: the first that is deep enough may come late, while a loop runs."""
        self._keep(system)
        self._append(pairs, wall, system.geometry)


@kernel
def keep_pressed_by_catheter(
    rows_address: Address[ContactRows],
    wall_address: Address[WallGeometry],
    pairs_address: Address[ContactPairs],
    states: tuple[BoolArray, BoolArray, IntArray],
) -> None:
    """Make pairs of the pressed contacts of the catheter with the wall; ``states`` as in `manifold.keep_pressed`.

    The point of the catheter is that of the row: a particle, or a place beyond it where a segment lies on a rim.
    """
    rows, wall, out = rows_at(rows_address), wall_at(wall_address), pairs_at(pairs_address)
    slides, slid, nodes = states
    out.count = 0
    for row in range(rows.n_contacts):
        if not (laws.HAS_GAP[rows.law[row]] and rows.force_n[row, 0] > 0.0):
            continue
        identity, is_catheter = rows.identity[row], rows.tool[row] == NO_TOOL and rows.stone[row] == NO_STONE
        if is_catheter and target_kind_of(identity) == DUCT_TRIANGLE:
            weights, s = row_of(rows.duct_weight, row), rows.rod_weight[row, 1]
            pair = (NO_TOOL, 0, rows.rod_node[row, 0], DUCT_TRIANGLE, target_of(identity), s, weights)
            place = write_pair(out, pair, rows.gap_m[row], row_of(rows.frame[row], 0))
            if place != FULL:
                slid[place] = slides[row]
    write_corners(out, wall, nodes)


@kernel
def append_kept(
    geometry_address: Address[ContactGeometry],
    kept_address: Address[ContactPairs],
    states: tuple[FloatArray, BoolArray],
    sizes: tuple[float, float],
    pairs_address: Address[ContactPairs],
) -> None:
    """Append kept points to the catheter's pairs, with fresh normals; arguments as in `manifold.append_pressed`."""
    corners, slid = states
    rod, kept, out = geometry_at(geometry_address).rod, pairs_at(kept_address), pairs_at(pairs_address)
    thickness, reach = rod.radius + sizes[0], rod.radius + sizes[0] + sizes[1]
    for i in range(kept.count):
        point = kept_point(kept, corners, i)
        away = subtract(_axis_point(rod, kept, i), point)
        distance = math.sqrt(dot(away, away))
        if distance == 0.0 or distance > reach or dot(away, row_of(kept.normal, i)) < FACING * distance:
            continue
        near = apart_m(thickness, 2.0 * sizes[0]) if slid[i] else 0.0
        shallowest = distance - thickness + least_approach_m(sizes[0])
        known = _known(out, rod, (point, kept.particle[i]), (near, shallowest, thickness))
        if known == NONE:
            weights, s = row_of(kept.target_weights, i), kept.tool_parameter[i]
            pair = (NO_TOOL, 0, kept.particle[i], DUCT_TRIANGLE, kept.target[i], s, weights)
            write_pair(out, pair, distance - thickness, scaled(away, 1.0 / distance))
        elif not slid[i] and out.particle[known] == kept.particle[i]:
            copy_point(kept, i, out, known)
            out.gap_m[known] = distance - thickness
            put_row(out.normal, known, scaled(away, 1.0 / distance))


@kernel
def _axis_point(rod: RodGeometry, pairs: ContactPairs, i: int) -> Vector:
    """Return where the catheter's point of a pair is on its axis."""
    first, s = pairs.particle[i], pairs.tool_parameter[i]
    second = min(first + 1, rod.position.shape[0] - 1)
    return along(scaled(row_of(rod.position, first), 1.0 - s), row_of(rod.position, second), s)


@kernel
def copy_point(kept: ContactPairs, i: int, pairs: ContactPairs, to: int) -> None:
    """Write where a kept point is, on the catheter and on the wall, over that of another pair."""
    pairs.target[to], pairs.tool_parameter[to] = kept.target[i], kept.tool_parameter[i]
    put_row(pairs.target_weights, to, row_of(kept.target_weights, i))


@kernel
def _known(pairs: ContactPairs, rod: RodGeometry, where: tuple[Vector, int], sizes: tuple[float, float, float]) -> int:
    """Return the catheter's pair near a particle that stands for a kept point of the wall, or `NONE`.

    One with the same point does, and one that is near and hardly less deep: the lips of a mouth that jaws squeeze are
    closest by turns, and what is found beside the one that is not may be 0.2 mm off it. ``where`` are point and
    particle; ``sizes`` how near, the largest gap, and the distance between axis and mid-surface.
    """
    (point, particle), (near, shallowest, thickness) = where, sizes
    same = ONE_POINT * thickness
    for k in range(pairs.count):
        if pairs.target_kind[k] != DUCT_TRIANGLE or abs(pairs.particle[k] - particle) > _BESIDE:
            continue
        known = along(_axis_point(rod, pairs, k), row_of(pairs.normal, k), -(pairs.gap_m[k] + thickness))
        apart_2 = squared_distance(known, point)
        if apart_2 < same * same or (apart_2 < near * near and pairs.gap_m[k] < shallowest):
            return k
    return NONE
