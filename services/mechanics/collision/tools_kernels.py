"""Detection of shafts and jaws against the wall and the catheter: what runs in every tick."""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.beside import (
    BULGE_M,
    NEARLY_M,
    Beside,
    apart_m,
    comes_nearer,
    go_to,
    hardly_slides,
    is_met,
    note_after,
    note_before,
    place_along,
    seen_from,
    start_round,
    start_segment,
    take_point,
)
from services.mechanics.collision.capsules import CapsuleMemory, Tools, detect_capsules, segment_ends
from services.mechanics.collision.nodes import corner_positions
from services.mechanics.collision.pairs import DUCT_TRIANGLE, SHAFT, ContactPairs, pairs_at
from services.mechanics.collision.primitives import index
from services.mechanics.collision.probes import EARLY, MINIMA, Probes, advance, forget
from services.mechanics.collision.regions import used_since
from services.mechanics.collision.search import NOT_FOUND, touch_triangle
from services.mechanics.collision.shell import Shell
from services.mechanics.collision.sides import TOUCHING_M, UNKNOWN
from services.mechanics.collision.writer import write_pair
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.compiled.vectors import Vector, along, combine, dot, row_of, scaled, squared_distance, subtract

N_SEGMENTS = 3
# Probes per segment. The shaft's are of PIECE_M, counted from the junction, the last reaching to the port: they
# stay where they are in the instrument while it slides through the port. A jaw's share the jaw, and the last is its
# tip: a wall that bulges there is nearer to a piece elsewhere until it is deep in the end of the jaw.
SHAFT_PROBES, JAW_PIECES = 13, 5
JAW_PROBES = JAW_PIECES + 1
PROBES_PER_TOOL = SHAFT_PROBES + 2 * JAW_PROBES
PIECE_M = 5e-3
# Cosine between normals from which two contacts at one place count as the same.
SAME_WAY = 0.5


class ToolDetection(Struct):
    """What detection works on, and what a tick leaves for the next."""

    shell: Shell
    probes: Probes  # `PROBES_PER_TOOL` a tool
    beside: Beside
    capsules: CapsuleMemory  # segments of tools against those of the catheter
    half_thickness_m: float
    catheter_radius_m: float
    margin_m: float


tool_detection_at = reader(ToolDetection)


@kernel
def detect_tools(
    address: Address[ToolDetection], tools: Tools, particles: FloatArray, pairs_address: Address[ContactPairs]
) -> None:
    """Append the pairs of this tick; see `tools.ToolContactDetector.detect`."""
    detection, pairs = tool_detection_at(address), pairs_at(pairs_address)
    _detect_wall(detection, tools, pairs)
    detect_capsules(detection.capsules, tools, particles, (detection.catheter_radius_m, detection.margin_m), pairs)


@inlined_kernel
def _detect_wall(detection: ToolDetection, tools: Tools, pairs: ContactPairs) -> None:
    detection.probes.due, detection.probes.is_aside = EARLY, detection.beside.close_m > 0.0
    for tool in range(tools[0].shape[0]):
        first = tool * PROBES_PER_TOOL
        for segment in range(N_SEGMENTS):
            count = SHAFT_PROBES if segment == SHAFT else JAW_PROBES
            if tools[2][tool] and tools[1][tool, segment] > 0.0:
                ends, thickness = (
                    segment_ends(tools, tool, segment),
                    tools[1][tool, segment] + detection.half_thickness_m,
                )
                for k in range(count):
                    piece, reach = _piece(segment, k, ends), thickness + detection.margin_m
                    # The first always is: without a length, the whole segment is a sphere. Tips of jaws are, too.
                    is_point = k == 0 or segment != SHAFT
                    _advance_piece(detection, first + k, piece, reach, is_point or piece[0] != piece[1])
                _write_segment(detection, (tool, segment), (first, first + count), ends, thickness, pairs)
            else:
                for k in range(count):
                    forget(detection.probes, first + k)
            first += count


@kernel
def forget_far(address: Address[ToolDetection], tools: Tools) -> None:
    """Forget the past of pieces that have come further than they reach since: they may have gone round the wall."""
    detection = tool_detection_at(address)
    probes = detection.probes
    for tool in range(tools[0].shape[0]):
        first = tool * PROBES_PER_TOOL
        for segment in range(N_SEGMENTS):
            ends, thickness = (
                segment_ends(tools, tool, segment),
                tools[1][tool, segment] + detection.half_thickness_m,
            )
            count = SHAFT_PROBES if segment == SHAFT else JAW_PROBES
            for k in range(count):
                piece = _piece(segment, k, ends)
                for end in range(2):
                    if not squared_distance(piece[end], row_of(probes.ends, first + k, end)) < thickness * thickness:
                        forget(probes, first + k)
            first += count


@inlined_kernel
def _advance_piece(
    detection: ToolDetection, i: int, ends: tuple[Vector, Vector], reach: float, is_inside: bool
) -> None:
    """Move a piece that is inside the patient; the others, beyond the port, have no past."""
    if not is_inside:
        forget(detection.probes, i)
    else:
        body, wall, look = detection.shell.body, detection.shell.wall, (reach, index(UNKNOWN))
        is_look = detection.beside.close_m > 0.0
        detection.probes.leeway_m = math.inf
        if not is_look:
            note_before(body, wall, detection.beside, detection.probes, i, ends)
            if _rests(detection, i, reach):
                detection.probes.leeway_m = BULGE_M
        elif _may_touch_more(detection, i, ends, reach):
            detection.probes.seen[i] = reach
        advance(body, wall, detection.probes, i, ends, look, look)
        if not is_look:
            note_after(detection.beside, detection.probes, i)


@kernel
def _rests(detection: ToolDetection, i: int, reach: float) -> bool:
    """Return whether a piece touches the wall and hardly slides along it."""
    probes = detection.probes
    is_touching = probes.distance[i, 0] < reach - detection.margin_m + NEARLY_M
    return bool(probes.triangle[i, 0] != NOT_FOUND and is_touching and hardly_slides(detection.beside, i))


@inlined_kernel
def _may_touch_more(detection: ToolDetection, i: int, ends: tuple[Vector, Vector], reach: float) -> bool:
    """Return whether a piece that touches the wall may touch it elsewhere, more than that is to be known.

    As it does once both have moved so much since it searched: only then there may be a bulge beside what it follows.
    """
    probes, body, close_m = detection.probes, detection.shell.body, detection.beside.close_m
    if probes.seen[i] < 0.0 or probes.triangle[i, 0] == NOT_FOUND:
        return False
    is_touching = probes.distance[i, 0] < reach - detection.margin_m + close_m
    return bool(is_touching and used_since(body, probes.near, i, ends, probes.search[i]) > close_m)


@kernel
def _piece(segment: int, k: int, ends: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
    """Return the ends of probe k of a segment: a shaft's are counted from its far end back, a jaw's last is its tip."""
    p, axis = ends[0], subtract(ends[1], ends[0])
    if segment != SHAFT:
        return (along(p, axis, k / JAW_PIECES), along(p, axis, min(k + 1, JAW_PIECES) / JAW_PIECES))
    length = math.sqrt(dot(axis, axis))
    piece = PIECE_M / length if length > 0.0 else 1.0
    start = 0.0 if k == SHAFT_PROBES - 1 else max(1.0 - (k + 1) * piece, 0.0)
    return (along(p, axis, start), along(p, axis, max(1.0 - k * piece, 0.0)))


@inlined_kernel
def _write_segment(
    detection: ToolDetection,
    who: tuple[int, int],
    span: tuple[int, int],
    ends: tuple[Vector, Vector],
    thickness: float,
    pairs: ContactPairs,
) -> None:
    """Write the contacts of one segment; of two neighbours meeting at one point the deeper stands for both."""
    probes = detection.probes
    start_segment(detection.beside)
    for i in range(span[0], span[1]):
        for k in range(MINIMA):
            gap, triangle = probes.distance[i, k] - thickness, probes.triangle[i, k]
            if triangle == NOT_FOUND or not gap < detection.margin_m or _is_repeated(probes, i, k, span):
                continue
            _write_minimum(detection, who, (i, k), ends, thickness, pairs)
    for i in range(span[0], span[1]):
        for k in range(MINIMA if comes_nearer(detection.beside, i) else 0):
            if 0.0 < probes.distance[i, k] < thickness + detection.margin_m and probes.triangle[i, k] != NOT_FOUND:
                _write_beside(detection, who, (i, k), ends, thickness, pairs)


@kernel
def _write_minimum(
    detection: ToolDetection,
    who: tuple[int, int],
    minimum: tuple[int, int],
    ends: tuple[Vector, Vector],
    thickness: float,
    pairs: ContactPairs,
) -> None:
    """Write the contact of a probe's minimum, as one of the whole segment unless that has crossed the wall.

    What is closest to the end of a piece lies off to the side of it: seen from there it is further away than it is.
    """
    probes, beside, (i, k) = detection.probes, detection.beside, minimum
    normal, distance = row_of(probes.normal, i, k), probes.distance[i, k]
    on_axis = _minimum_point(probes, i, k)
    point = along(on_axis, normal, -distance)
    s = place_along(on_axis, ends)
    if distance > TOUCHING_M:
        s, distance, normal = seen_from(point, ends)
    is_tip = who[1] != SHAFT and row_of(probes.ends, i, 0) == row_of(probes.ends, i, 1)
    if not take_point(beside, point, apart_m(thickness, beside.wall_m) if is_tip else 0.0):
        return
    pair = (who[0], who[1], -1, DUCT_TRIANGLE, probes.triangle[i, k], s, row_of(probes.weights, i, k))
    write_pair(pairs, pair, distance - thickness, normal)


@inlined_kernel
def _write_beside(
    detection: ToolDetection,
    who: tuple[int, int],
    minimum: tuple[int, int],
    ends: tuple[Vector, Vector],
    thickness: float,
    pairs: ContactPairs,
) -> None:
    """Write the contacts of a segment with the triangles round a minimum of one of its probes; see `beside`."""
    shell, beside, (i, k) = detection.shell, detection.beside, minimum
    body, wall, (a, b), apart = shell.body, shell.wall, ends, apart_m(thickness, beside.wall_m)
    facing, seed, following = row_of(detection.probes.normal, i, k), detection.probes.triangle[i, k], 0
    start_round(beside, seed)
    while following < beside.queued:
        triangle = index(beside.queue[following])
        following += 1
        _, squared, _, w = touch_triangle(body, wall, triangle, a, b)
        p0, p1, p2 = corner_positions(body, wall, triangle)
        point = combine(w, p0, p1, p2)
        s, distance, normal = seen_from(point, ends)
        if triangle != seed:
            if squared == 0.0 or not is_met(beside, i, facing, (distance - thickness, normal)):
                continue
            is_due = beside.close_m == 0.0 or distance - thickness < beside.close_m
            if is_due and take_point(beside, point, apart):
                pair = (who[0], who[1], -1, DUCT_TRIANGLE, triangle, s, w)
                write_pair(pairs, pair, distance - thickness, normal)
        for edge in range(3):
            go_to(beside, wall.neighbour[triangle, edge])


@kernel
def _minimum_point(probes: Probes, i: int, k: int) -> Vector:
    return _axis_point(probes, i, probes.parameter[i, k])


@kernel
def _axis_point(probes: Probes, i: int, s: float) -> Vector:
    return along(scaled(row_of(probes.ends, i, 0), 1.0 - s), row_of(probes.ends, i, 1), s)


@kernel
def _is_repeated(probes: Probes, i: int, k: int, span: tuple[int, int]) -> bool:
    """Return whether the probe before or after has a deeper contact of the same direction close by."""
    mine = probes.distance[i, k]
    point, normal = _minimum_point(probes, i, k), row_of(probes.normal, i, k)
    for j in (i - 1, i + 1):
        if j < span[0] or j >= span[1]:
            continue
        near2 = 0.25 * min(_length2(probes, i), _length2(probes, j))
        for other in range(MINIMA):
            deeper = probes.distance[j, other] - mine
            if probes.triangle[j, other] == NOT_FOUND or deeper > 0.0 or (deeper == 0.0 and j > i):
                continue
            is_same_way = dot(normal, row_of(probes.normal, j, other)) > SAME_WAY
            if is_same_way and squared_distance(point, _minimum_point(probes, j, other)) < near2:
                return True
    return False


@kernel
def _length2(probes: Probes, i: int) -> float:
    return squared_distance(row_of(probes.ends, i, 0), row_of(probes.ends, i, 1))
