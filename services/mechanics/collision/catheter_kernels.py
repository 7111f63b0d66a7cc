"""Detection of the catheter's particles and segments against the wall: what runs in every tick."""

from __future__ import annotations

import math
from typing import Annotated

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.folds import flank_on, is_new_flank, may_be_flank
from services.mechanics.collision.inside import Lumen, cap_clearance, follow_caps
from services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs, pairs_at
from services.mechanics.collision.primitives import index
from services.mechanics.collision.probes import (
    EARLY,
    MINIMA,
    SKIN_M,
    Probes,
    advance,
    forget,
    is_near,
    motion_to,
)
from services.mechanics.collision.rim import RimMemory, detect_rims
from services.mechanics.collision.search import NOT_FOUND, closest, walk
from services.mechanics.collision.shell import Shell
from services.mechanics.collision.sides import INSIDE, OUTSIDE, UNKNOWN, Contact, contact_of
from services.mechanics.collision.writer import is_due, write_pair
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.compiled.vectors import Vector, along, dot, put_row, row, row_of

# A flank of 12 degrees is in sight from 0.21 of the thickness before the fold on. Who moves further than that in a tick
# also looks for flanks from where it will be.
UNSEEN = 0.21
STILL = (0.0, 0.0, 0.0)


class CatheterDetection(Struct):
    """What detection of n particles works on, and what a tick leaves for the next."""

    shell: Shell
    probes: Probes  # a particle each
    lumen: Lumen
    rims: RimMemory
    motion: Annotated[FloatArray, "n", 3]  # of the particles since the last tick
    thickness_m: float  # radius of the catheter and half that of the wall
    margin_m: float


catheter_detection_at = reader(CatheterDetection)


@kernel
def detect_catheter(
    address: Address[CatheterDetection], positions: FloatArray, pairs_address: Address[ContactPairs]
) -> None:
    """Append the pairs of this tick; see `catheter.CatheterContactDetector.detect`."""
    detection, pairs = catheter_detection_at(address), pairs_at(pairs_address)
    sizes = (detection.thickness_m, detection.margin_m)
    for i in range(positions.shape[0]):
        put_row(detection.motion, i, motion_to(detection.probes, i, row(positions, i)))
    detect_rims(detection.shell, detection.rims, positions, detection.motion, sizes, pairs)
    detection.probes.due = EARLY
    for i in range(positions.shape[0]):
        p = row(positions, i)
        if is_near(p):
            _detect_particle(detection, i, p, row(detection.motion, i), pairs)
        else:
            forget(detection.probes, i)


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


@kernel
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
            _write_flanks(detection, (i, k), (p, STILL), motion, reach, pairs, start)
            if moved > UNSEEN * thickness:
                _write_flanks(detection, (i, k), (p, motion), motion, reach, pairs, start)


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


@kernel
def _write_flanks(
    detection: CatheterDetection,
    minimum: tuple[int, int],
    place: tuple[Vector, Vector],
    motion: Vector,
    reach: float,
    pairs: ContactPairs,
    start: int,
) -> None:
    """Append pairs with the other flanks of the fold that a minimum (particle, which of its two) lies in; see `folds`.

    ``place`` holds the particle and how far ahead of it to look.
    """
    body, wall, probes, (i, k), (p, ahead) = (
        detection.shell.body,
        detection.shell.wall,
        detection.probes,
        minimum,
        place,
    )
    triangle, side, q = index(probes.triangle[i, k]), index(probes.side[i, k]), along(p, ahead, 1.0)
    middle = triangle
    if dot(ahead, ahead) > 0.0:
        middle = walk(body, wall, triangle, q, q, reach)[0]
    if middle == NOT_FOUND:
        return
    begin, ring, normal = wall.ring_start, wall.ring, row_of(probes.normal, i, k)
    for corner in range(3):
        vertex = wall.triangles[middle, corner]
        for at in range(begin[vertex], begin[vertex + 1]):
            if not may_be_flank(body, wall, ring[at], normal):
                continue
            touch = flank_on(body, wall, triangle, ring[at], (q, q), reach)
            if touch[0] != NOT_FOUND:
                _write_flank(detection, i, contact_of(body, wall, touch, q, q, side), ahead, motion, pairs, start)


@kernel
def _write_flank(
    detection: CatheterDetection,
    i: int,
    contact: Contact,
    ahead: Vector,
    motion: Vector,
    pairs: ContactPairs,
    start: int,
) -> None:
    """Append the pair of a flank as seen from ``ahead`` of a particle, if it is due.

    What lies ahead cannot overlap yet: a plane that seems to is that of a flank round a corner, which is not there
    where the particle is.
    """
    touch, normal, distance, _ = contact
    distance -= dot(ahead, normal)
    least, gap = detection.thickness_m if dot(ahead, ahead) > 0.0 else 0.0, distance - detection.thickness_m
    is_near_it = distance > least and is_due(gap, normal, motion, detection.margin_m)
    if is_near_it and is_new_flank(pairs, start, normal):
        write_pair(pairs, (NO_TOOL, 0, i, DUCT_TRIANGLE, touch[0], 0.0, touch[3]), gap, normal)


@kernel
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
        lumen.inside[i] = 1 if side == INSIDE else 0
