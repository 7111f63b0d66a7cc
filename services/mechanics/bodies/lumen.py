"""Finds the particles of the catheter in the lumen, and its length beyond the opening by which it entered.

The lumen is the volume enclosed by the wall and caps over its openings. The axis never crosses the wall, so along the
catheter the side changes only at caps: it is known at the first particle, and every crossing of a cap reverses it.
"""

from __future__ import annotations

import math

import numpy as np

from trocar.services.mechanics.arrays import ByteArray, FloatArray, IntArray
from trocar.services.mechanics.bodies.wall_motion import wall_motion
from trocar.services.mechanics.collision.primitives import segment_pierces
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.vectors import Vector, along, cross, dot, row, squared_distance, subtract
from trocar.services.mechanics.reduction import ReducedDuct
from trocar.services.mechanics.surface.mesh import TriangleMesh, boundary_loops
from trocar.services.mechanics.surface.rim_caps import fill_rim

OUTSIDE = -1.0
Caps = tuple[IntArray, IntArray, FloatArray]
"""Triangles (m, 3) of all caps, the end index of each cap, and scratch for a radius of each."""
Placed = tuple[FloatArray, FloatArray]


class MovingLumen:
    """The volume enclosed by a duct's wall and the caps over its openings, moving with the modes, and a catheter in it.

    Args:
        n_particles: int

    Attributes:
        inside: (n_particles,) int8. One where a particle is in the lumen, as of the last `follow`.
        openings: tuple of str. Names of the openings, each a set of vertices of the mesh; empty where an opening has
            none.
        entered_by: str. Name of the opening by which the tip entered, as of the last `follow`; empty if none.
    """

    def __init__(self, duct: ReducedDuct, n_particles: int) -> None:
        mesh = duct.mesh
        rims = boundary_loops(mesh)
        self.openings, self.entered_by = tuple(opening_name(mesh, rim) for rim in rims), ""
        caps = [fill_rim(mesh.vertices_m, rim) for rim in rims]
        triangles = np.concatenate([np.zeros((0, 3), np.int32), *caps])
        self._nodes, local = np.unique(triangles, return_inverse=True)
        self._nodes = self._nodes.astype(np.int32)
        ends = np.cumsum([len(cap) for cap in caps], dtype=np.int32)
        self._caps = np.ascontiguousarray(local.reshape(-1, 3), np.int32), ends, np.zeros(len(ends))
        self._closed, self._mesh = np.concatenate([mesh.triangles, triangles]), mesh
        self._motion = wall_motion(duct, 1)
        self._corner_positions = self._motion.position_function(self._nodes)
        self.inside = np.zeros(n_particles, np.int8)
        self._begins_inside = False
        self._base_m: FloatArray | None = None
        self._corners_m = mesh.vertices_m[self._nodes]

    def follow(self, q: FloatArray, position_m: FloatArray) -> float:
        """Find which particles (n, 3) are inside; return where the axis last crosses a cap, in segments from its start.

        It is `OUTSIDE` if the tip is not in the lumen, and 0 if the whole catheter is.
        """
        self._motion.update(q)
        corners_m = self._corner_positions(q)
        self._follow_base(q, position_m[0], corners_m)
        place: float
        place, cap = cross_caps(position_m, corners_m, self._caps, self._begins_inside, self.inside)
        self.entered_by = self.openings[cap] if cap >= 0 else ""
        return place

    def inserted_length_m(self, q: FloatArray, position_m: FloatArray, segment_m: float) -> float:
        """Return the rest length from the catheter's last crossing of a cap to its tip, 0 if the tip is outside."""
        place = self.follow(q, position_m)
        return 0.0 if place == OUTSIDE else (len(position_m) - 1 - place) * segment_m

    def _follow_base(self, q: FloatArray, base_m: FloatArray, corners_m: FloatArray) -> None:
        """Update the side of the first particle: at first by the winding number of the wall, then by crossings of caps.

        The path tested goes from its last position, carried along with the caps, to the present one.
        """
        if self._base_m is None:
            every = np.arange(self._mesh.n_vertices, dtype=np.int32)
            self._begins_inside = (
                abs(winding_number(base_m, self._closed, self._motion.position_function(every)(q))) > 0.5
            )
            self._base_m, self._corners_m = base_m, corners_m
        before = self._base_m, self._corners_m
        self._begins_inside ^= crosses_caps(before, (base_m, corners_m), self._caps)
        self._base_m, self._corners_m = base_m.copy(), corners_m


def opening_name(mesh: TriangleMesh, rim: IntArray) -> str:
    """Return the name of the smallest set of vertices that contains a whole rim; empty for none."""
    named = [(len(own), name == "clamped", name) for name, own in mesh.vertex_sets.items() if np.isin(rim, own).all()]
    return min(named, default=(0, False, ""))[2]


@kernel
def crosses_caps(before: Placed, now: Placed, caps: Caps) -> bool:
    """Return whether a point, carried along by each cap, changes sides on its way to its present position.

    ``before`` and ``now`` are each (the point (3,), the corners of the caps).
    """
    (triangles, ends, _), first, changes = caps, 0, False
    was, here = (before[0][0], before[0][1], before[0][2]), (now[0][0], now[0][1], now[0][2])
    for cap in range(ends.shape[0]):
        p = was
        for t in range(first, ends[cap]):
            for corner in range(3):
                came = subtract(row(now[1], triangles[t, corner]), row(before[1], triangles[t, corner]))
                p = along(p, came, 1.0 / (3 * (ends[cap] - first)))
        if _crossing(p, here, now[1], triangles, (first, ends[cap])) >= 0.0:
            changes = not changes
        first = ends[cap]
    return changes


@kernel
def cross_caps(
    position: FloatArray, corners: FloatArray, caps: Caps, begins_inside: bool, inside: ByteArray
) -> tuple[float, int]:
    """Write which particles are inside; return where the axis last crosses a cap, in segments, and the cap's index.

    ``corners`` (k, 3) are the positions of the caps' corners.
    """
    triangles, ends, radii = caps
    _measure_caps(corners, caps)
    inside[0] = 1 if begins_inside else 0
    last, by = 0.0, -1
    for i in range(position.shape[0] - 1):
        p, q, first, turns = row(position, i), row(position, i + 1), 0, 0
        for cap in range(ends.shape[0]):
            reach = radii[cap] + math.sqrt(squared_distance(p, q))
            if squared_distance(p, row(corners, triangles[first, 0])) <= reach * reach:
                place = _crossing(p, q, corners, triangles, (first, ends[cap]))
                if place >= 0.0:
                    turns += 1
                    last, by = i + place, cap
            first = ends[cap]
        inside[i + 1] = inside[i] if turns % 2 == 0 else 1 - inside[i]
    return (last, by) if inside[position.shape[0] - 1] else (OUTSIDE, -1)


@inlined_kernel
def _measure_caps(corners: FloatArray, caps: Caps) -> None:
    """Write the radius of a bounding sphere about the first corner of each cap."""
    (triangles, ends, radii), first = caps, 0
    for cap in range(ends.shape[0]):
        middle, radius_2 = row(corners, triangles[first, 0]), 0.0
        for t in range(first, ends[cap]):
            for corner in range(3):
                radius_2 = max(radius_2, squared_distance(middle, row(corners, triangles[t, corner])))
        radii[cap], first = math.sqrt(radius_2), ends[cap]


@kernel
def _crossing(p: Vector, q: Vector, corners: FloatArray, triangles: IntArray, span: tuple[int, int]) -> float:
    """Return where a segment crosses a cap, from 0 to below 1, or -1; an edge of two triangles counts once."""
    for t in range(span[0], span[1]):
        a, b, c = row(corners, triangles[t, 0]), row(corners, triangles[t, 1]), row(corners, triangles[t, 2])
        meets, s, _ = segment_pierces(p, q, a, b, c)
        if meets and s < 1.0:
            return s
    return -1.0


def winding_number(point_m: FloatArray, triangles: IntArray, vertices_m: FloatArray) -> float:
    """Return the winding number of a closed surface about a point: 1 or -1 inside, by its orientation, 0 outside."""
    return float(_solid_angle((point_m[0], point_m[1], point_m[2]), triangles, vertices_m) / (4.0 * math.pi))


@kernel
def _solid_angle(p: Vector, triangles: IntArray, vertices: FloatArray) -> float:
    """Return the solid angle of triangles (m, 3) seen from p (van Oosterom and Strackee 1983)."""
    total = 0.0
    for t in range(triangles.shape[0]):
        a = subtract(row(vertices, triangles[t, 0]), p)
        b = subtract(row(vertices, triangles[t, 1]), p)
        c = subtract(row(vertices, triangles[t, 2]), p)
        la, lb, lc = math.sqrt(dot(a, a)), math.sqrt(dot(b, b)), math.sqrt(dot(c, c))
        beside = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
        total += 2.0 * math.atan2(dot(a, cross(b, c)), beside)
    return total
