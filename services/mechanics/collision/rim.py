"""Contacts of the catheter's segments with the edge of an opening, where it crosses between two particles."""

from __future__ import annotations

import math

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.folds import flank_on, is_new_flank
from services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL
from services.mechanics.collision.primitives import put, vector
from services.mechanics.collision.probes import SKIN_M, Probes, motion_to
from services.mechanics.collision.search import NOTHING, Touch, closest, distance_to_all, offset
from services.mechanics.collision.surface import Shell, corner_positions
from services.mechanics.collision.writer import Rows, is_due, write_pair
from services.mechanics.compiled import Struct, fill, floats, ints, kernel, struct_reader, struct_type
from services.mechanics.compiled.vectors import Vector, along, combine, dot, scaled, squared_distance

# Nearer to a particle than this part of a segment, the particle's own contact does.
END_PART = 0.05
_TOUCHING_M = 1e-9

RimMemory = Struct
RIM_MEMORY = struct_type(
    arrays=(
        "edge",  # (m,) int32 rim edge within reach of each segment at the last tick, or NOTHING
        "place",  # (m, 3) weights of the point touched
        "normal",  # (m, 3) towards the segment
        "ends",  # (m, 2, 3) of the segment at the last search that found no edge within reach
        "travel",  # (m,) the wall's travel then
        "slack",  # (m,) motion of segment and wall after which an edge may be within reach; negative: search
    )
)
memory_at = struct_reader(RIM_MEMORY)


class RimSegments:
    """What m segments of a catheter remember of the rims."""

    def __init__(self, m: int) -> None:
        self._edge = np.full(m, NOTHING, np.int32)
        self._slack = np.full(m, -1.0)
        self._alive: dict[str, np.ndarray] = {
            "place": np.zeros((m, 3)),
            "normal": np.zeros((m, 3)),
            "ends": np.zeros((m, 2, 3)),
            "travel": np.zeros(m),
        }
        self._storage = np.zeros(1, RIM_MEMORY)
        self.address: int = self._storage.ctypes.data
        fill(self._storage[0], edge=self._edge, slack=self._slack, **self._alive)

    def reset(self) -> None:
        """Drop the past of every segment."""
        self._edge.fill(NOTHING)
        self._slack.fill(-1.0)


@kernel
def detect_rims(
    shell: Shell, memory: RimMemory, probes: Probes, positions: FloatArray, sizes: tuple[float, float], rows: Rows
) -> None:
    """Append pairs of segments with rim edges.

    ``sizes`` holds (radius + half thickness, margin), ``probes`` where the particles were in the last tick.
    """
    for i in range(positions.shape[0] - 1):
        a = (positions[i, 0], positions[i, 1], positions[i, 2])
        b = (positions[i + 1, 0], positions[i + 1, 1], positions[i + 1, 2])
        _detect_segment(shell, memory, i, (a, b), (motion_to(probes, i, a), motion_to(probes, i + 1, b)), sizes, rows)


@kernel
def _detect_segment(
    shell: Shell,
    memory: RimMemory,
    i: int,
    ends: tuple[Vector, Vector],
    motions: tuple[Vector, Vector],
    sizes: tuple[float, float],
    rows: Rows,
) -> None:
    thickness, margin = sizes
    moved = math.sqrt(max(dot(motions[0], motions[0]), dot(motions[1], motions[1])))
    if _is_still_far(shell, memory, i, ends, moved):
        return
    reach = thickness + margin + moved
    touch = closest(shell.body, shell.rims, ends[0], ends[1], reach + SKIN_M, NOTHING)
    floats(memory.slack)[i] = -1.0
    if not touch[1] < reach * reach:
        _note_far(shell, memory, i, ends, math.sqrt(touch[1]), thickness + margin)
        return
    distance, normal = _signed(shell, memory, i, touch, ends, thickness)
    start = rows.used
    _write(shell, i, touch, (distance, normal), motions, sizes, rows)
    if distance > 0.0:
        _write_flanks(shell, i, (touch[0], normal, reach), ends, motions, sizes, rows, start)


@kernel
def _write_flanks(
    shell: Shell,
    i: int,
    found: tuple[int, Vector, float],
    ends: tuple[Vector, Vector],
    motions: tuple[Vector, Vector],
    sizes: tuple[float, float],
    rows: Rows,
    start: int,
) -> None:
    """Append pairs with the edges beside the one ``found``, where the rim bends round the segment; see `folds`."""
    rims, (edge, normal, reach) = shell.rims, found
    begin, ring = ints(rims.ring_start), ints(rims.ring)
    for corner in range(2):
        vertex = ints(rims.triangles)[3 * edge + corner]
        for place in range(begin[vertex], begin[vertex + 1]):
            touch = flank_on(shell.body, rims, edge, ring[place], ends, reach)
            if touch[0] == NOTHING or touch[1] < _TOUCHING_M**2:
                continue
            distance = math.sqrt(touch[1])
            away = scaled(offset(shell.body, rims, touch, ends[0], ends[1]), 1.0 / distance)
            if dot(away, normal) > 0.0 and is_new_flank(rows, start, away):
                _write(shell, i, touch, (distance, away), motions, sizes, rows)


@kernel
def _is_still_far(shell: Shell, memory: RimMemory, i: int, ends: tuple[Vector, Vector], ahead: float) -> bool:
    """Return whether segment and wall have moved too little since the last search to meet within ``ahead`` more."""
    slack = floats(memory.slack)[i]
    if slack < 0.0:
        return False
    last = floats(memory.ends)
    moved_2 = max(squared_distance(ends[0], vector(last, 2 * i)), squared_distance(ends[1], vector(last, 2 * i + 1)))
    is_far: bool = math.sqrt(moved_2) + shell.body.travel - floats(memory.travel)[i] + ahead < slack
    return is_far


@kernel
def _note_far(
    shell: Shell, memory: RimMemory, i: int, ends: tuple[Vector, Vector], distance: float, reach: float
) -> None:
    ints(memory.edge)[i] = NOTHING
    put(floats(memory.ends), 2 * i, ends[0])
    put(floats(memory.ends), 2 * i + 1, ends[1])
    floats(memory.travel)[i] = shell.body.travel_noted
    floats(memory.slack)[i] = max(distance, distance_to_all(shell.body, shell.rims, ends[0], ends[1])) - reach


@kernel
def _signed(
    shell: Shell, memory: RimMemory, i: int, touch: Touch, ends: tuple[Vector, Vector], thickness: float
) -> tuple[float, Vector]:
    """Return distance and normal, negative and turned back where the segment has been drawn through the edge."""
    edges, normals = ints(memory.edge), floats(memory.normal)
    away = offset(shell.body, shell.rims, touch, ends[0], ends[1])
    distance, old = math.sqrt(dot(away, away)), vector(normals, i)
    is_known = edges[i] != NOTHING and _is_same_lip(shell, memory, i, touch, thickness)
    normal = scaled(away, 1.0 / distance) if distance > _TOUCHING_M else old
    if is_known and 0.0 < touch[2] < 1.0 and dot(normal, old) < 0.0:
        normal, distance = scaled(normal, -1.0), -distance
    edges[i] = touch[0]
    put(floats(memory.place), i, touch[3])
    put(normals, i, normal)
    return distance, normal


@kernel
def _is_same_lip(shell: Shell, memory: RimMemory, i: int, touch: Touch, thickness: float) -> bool:
    """Return whether the point touched is near the last one: across a narrow mouth there is another lip."""
    p0, p1, p2 = corner_positions(shell.body, shell.rims, ints(memory.edge)[i])
    last = combine(vector(floats(memory.place), i), p0, p1, p2)
    q0, q1, q2 = corner_positions(shell.body, shell.rims, touch[0])
    return squared_distance(last, combine(touch[3], q0, q1, q2)) < thickness * thickness


@kernel
def _write(
    shell: Shell,
    i: int,
    touch: Touch,
    contact: tuple[float, Vector],
    motions: tuple[Vector, Vector],
    sizes: tuple[float, float],
    rows: Rows,
) -> None:
    """Append the pair of a touch with this distance and normal, unless it is a particle's or too far away."""
    s, gap, normal = touch[2], contact[0] - sizes[0], contact[1]
    motion = along(scaled(motions[0], 1.0 - s), motions[1], s)
    if not (END_PART < s < 1.0 - END_PART and is_due(gap, normal, motion, sizes[1])):
        return
    owner = ints(shell.rim_edges.owner)[touch[0]]
    start, end = touch[3][0], 1.0 - touch[3][0]
    weights = (start, end, 0.0)
    if owner % 3 == 1:
        weights = (0.0, start, end)
    elif owner % 3 == 2:
        weights = (end, 0.0, start)
    write_pair(rows, (NO_TOOL, 0, i, DUCT_TRIANGLE, owner // 3, s, weights), gap, normal)
