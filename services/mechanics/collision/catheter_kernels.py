"""Detection of the catheter's particles and segments against the wall: what runs in every tick."""

from __future__ import annotations

import math
from typing import Annotated

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.ahead import is_met_first, places_of, slide_of
from services.mechanics.collision.folds import flank_on, is_new_flank, may_be_flank
from services.mechanics.collision.inside import Lumen, cap_clearance, follow_caps, put_inside
from services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs, pairs_at
from services.mechanics.collision.primitives import index
from services.mechanics.collision.probes import (
    EARLY,
    JUMP_M,
    MINIMA,
    SKIN_M,
    Probes,
    advance,
    forget,
    is_near,
    motion_to,
    wall_motion,
)
from services.mechanics.collision.rim import RimMemory, detect_rims
from services.mechanics.collision.search import NOT_FOUND, closest, walk
from services.mechanics.collision.shell import Shell
from services.mechanics.collision.sides import INSIDE, OUTSIDE, UNKNOWN, contact_of
from services.mechanics.collision.writer import is_due, write_pair
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.compiled.vectors import Vector, along, dot, put_row, put_row_of, row, row_of, scaled, subtract


class CatheterDetection(Struct):
    """What detection of n particles works on, and what a tick leaves for the next."""

    shell: Shell
    probes: Probes  # a particle each
    lumen: Lumen
    rims: RimMemory
    motion: Annotated[FloatArray, "n", 3]  # of the particles, as expected of this tick
    against: Annotated[FloatArray, "n", MINIMA, 3]  # of the last tick, against the walls that they were closest to
    thickness_m: float  # radius of the catheter and half that of the wall
    margin_m: float


catheter_detection_at = reader(CatheterDetection)


@kernel
def detect_catheter(
    address: Address[CatheterDetection], positions: FloatArray, ahead: FloatArray, pairs_address: Address[ContactPairs]
) -> None:
    """Append the pairs of this tick; see `catheter.CatheterContactDetector.detect`."""
    detection, pairs = catheter_detection_at(address), pairs_at(pairs_address)
    sizes = (detection.thickness_m, detection.margin_m)
    for i in range(positions.shape[0]):
        put_row(detection.motion, i, _expected_motion(detection, i, row(positions, i), row(ahead, i)))
    detect_rims(detection.shell, detection.rims, positions, detection.motion, sizes, pairs)
    detection.probes.due = EARLY
    for i in range(positions.shape[0]):
        p = row(positions, i)
        if is_near(p):
            _detect_particle(detection, i, p, row(detection.motion, i), pairs)
        else:
            forget(detection.probes, i)


@kernel
def _expected_motion(detection: CatheterDetection, i: int, p: Vector, ahead: Vector) -> Vector:
    """Return how far a particle at p will move: as in the last tick, alone or against the wall, or ``ahead``.

    Whichever is furthest. What has been let go is where it was, and goes far in the next tick; what a wall that swings
    comes to meets it at rest.
    """
    body, wall, probes = detection.shell.body, detection.shell.wall, detection.probes
    went = motion_to(probes, i, p)
    for k in range(MINIMA):
        put_row_of(detection.against, i, k, subtract(went, wall_motion(body, wall, probes, i, k)))
    against = row_of(detection.against, i, 0)
    furthest = against if dot(against, against) > dot(went, went) else went
    is_further = dot(furthest, furthest) < dot(ahead, ahead) < JUMP_M * JUMP_M
    return ahead if is_further else furthest


@kernel
def enters_by_openings(address: Address[CatheterDetection]) -> bool:
    """Return whether every segment between a particle in the lumen and one outside is near the cap of an opening.

    Nearer than a particle on the rim is to the cap, since there flags are those of the particles and not of the rim.
    """
    detection = catheter_detection_at(address)
    inside, ends, shell = detection.lumen.inside, detection.probes.ends, detection.shell
    for i in range(inside.shape[0] - 1):
        if inside[i] != inside[i + 1]:
            a, b = row_of(ends, i, 0), row_of(ends, i + 1, 0)
            near_m = detection.thickness_m + detection.margin_m
            if closest(shell.body, shell.caps, a, b, near_m, index(NOT_FOUND))[0] == NOT_FOUND:
                return False
    return True


@inlined_kernel
def _detect_particle(detection: CatheterDetection, i: int, p: Vector, motion: Vector, pairs: ContactPairs) -> None:
    thickness, margin, start = detection.thickness_m, detection.margin_m, pairs.count
    moved = math.sqrt(dot(motion, motion))
    reach = thickness + margin + moved
    _follow_particle(detection, i, p, (thickness + margin, reach))
    is_touched = False
    for k in range(MINIMA):
        is_touched = _write_minimum(detection, i, k, motion, pairs) or is_touched
    for k in range(MINIMA):
        if is_touched and detection.probes.triangle[i, k] != NOT_FOUND:
            _write_flanks(detection, (i, k), p, motion, reach, pairs, start)
            _write_ahead(detection, (i, k), p, motion, reach, pairs, start)


@kernel
def _write_minimum(detection: CatheterDetection, i: int, k: int, motion: Vector, pairs: ContactPairs) -> bool:
    """Append the pair of a minimum, if it is due, and return whether it is."""
    probes = detection.probes
    triangle, normal = probes.triangle[i, k], row_of(probes.normal, i, k)
    gap = probes.distance[i, k] - detection.thickness_m
    if triangle == NOT_FOUND or not is_due(gap, normal, motion, detection.margin_m):
        return False
    weights = row_of(probes.weights, i, k)
    write_pair(pairs, (NO_TOOL, 0, i, DUCT_TRIANGLE, triangle, 0.0, weights), gap, normal)
    return True


@inlined_kernel
def _write_flanks(
    detection: CatheterDetection,
    minimum: tuple[int, int],
    p: Vector,
    motion: Vector,
    reach: float,
    pairs: ContactPairs,
    start: int,
) -> None:
    """Append pairs with the other flanks of the fold that a minimum (particle, which of two) lies in; see `folds`."""
    body, wall, probes, (i, k) = detection.shell.body, detection.shell.wall, detection.probes, minimum
    triangle, side = index(probes.triangle[i, k]), index(probes.side[i, k])
    begin, ring, normal = wall.ring_start, wall.ring, row_of(probes.normal, i, k)
    for corner in range(3):
        vertex = wall.triangles[triangle, corner]
        for at in range(begin[vertex], begin[vertex + 1]):
            if not may_be_flank(body, wall, ring[at], normal):
                continue
            touch = flank_on(body, wall, triangle, ring[at], (p, p), reach)
            if touch[0] == NOT_FOUND:
                continue
            _, away, distance, _ = contact_of(body, wall, touch, p, p, side)
            gap = distance - detection.thickness_m
            if distance > 0.0 and is_due(gap, away, motion, detection.margin_m) and is_new_flank(pairs, start, away):
                write_pair(pairs, (NO_TOOL, 0, i, DUCT_TRIANGLE, touch[0], 0.0, touch[3]), gap, away)


@inlined_kernel
def _write_ahead(
    detection: CatheterDetection,
    minimum: tuple[int, int],
    p: Vector,
    motion: Vector,
    reach: float,
    pairs: ContactPairs,
    start: int,
) -> None:
    """Append the pairs of what a minimum (particle, which of two) will be while the particle slides along the wall."""
    body, wall, probes, (i, k) = detection.shell.body, detection.shell.wall, detection.probes, minimum
    normal, triangle, side = row_of(probes.normal, i, k), index(probes.triangle[i, k]), index(probes.side[i, k])
    slide = slide_of(motion, normal, probes.distance[i, k] - detection.thickness_m)
    places = places_of(slide, normal)
    for place in range(places):
        way = scaled(slide, (place + 1) / places)
        q = along(p, way, 1.0)
        touch = walk(body, wall, triangle, q, q, reach)
        if touch[0] == NOT_FOUND or touch[1] > reach * reach:
            return
        triangle = touch[0]
        _, away, distance, _ = contact_of(body, wall, touch, q, q, side)
        gap = distance - detection.thickness_m
        if distance > 0.0 and is_met_first(pairs, start, way, (gap, away)):
            pair = (NO_TOOL, 0, i, DUCT_TRIANGLE, triangle, 0.0, touch[3])
            write_pair(pairs, pair, gap - dot(way, away), away)


@inlined_kernel
def _follow_particle(detection: CatheterDetection, i: int, p: Vector, reaches: tuple[float, float]) -> None:
    """Update flag and minima of one particle; each vouches for the other where it alone can know.

    ``reaches`` is how far it looks on its way to p and how far from there.
    """
    shell, probes, lumen, first = detection.shell, detection.probes, detection.lumen, 0
    follow_caps(shell, lumen, i, row_of(probes.ends, i, 0), p, probes.triangle[i, first])
    clearance, side = cap_clearance(shell.body, lumen, i, p), INSIDE if lumen.inside[i] else OUTSIDE
    on_the_way = (reaches[0], side if clearance > reaches[0] + SKIN_M else UNKNOWN)
    there = (reaches[1], side if clearance > reaches[1] + SKIN_M else UNKNOWN)
    advance(shell.body, shell.wall, probes, i, (p, p), on_the_way, there)
    distance, side = probes.distance[i, first], probes.side[i, first]
    if probes.triangle[i, first] == NOT_FOUND or side == UNKNOWN or distance <= 0.0:
        return
    if cap_clearance(shell.body, lumen, i, p) > distance:
        put_inside(lumen, i, side == INSIDE)
