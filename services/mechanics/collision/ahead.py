"""What a body that slides along a surface comes to in this tick, beside what it is closest to at the start of it.

Rows know planes. Who slides half a millimetre along one, at half a metre a second, would be in the next facet.
"""

from __future__ import annotations

import math

from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.compiled import kernel
from services.mechanics.compiled.vectors import Vector, along, dot, row

# Who goes no further along the wall than this in a tick comes a micrometre nearer to it where it is round, and at an
# edge of the mesh no deeper into the next facet than the next ticks take back.
LEAST_SLIDE_M = 50e-6
# A facet that would be met no deeper than this beyond those that are known is one with them.
ALIKE_M = 10e-6
# Facets are looked for at places so far apart, at so many at most.
STRIDE_M, MOST_PLACES = 0.3e-3, 4


@kernel
def slide_of(motion: Vector, normal: Vector, gap: float) -> Vector:
    """Return what a motion comes to that a contact with this normal and gap stops."""
    nearer = dot(motion, normal)
    return along(motion, normal, max(nearer, -max(gap, 0.0)) - nearer)


@kernel
def places_of(slide: Vector, normal: Vector) -> int:
    """Return at how many places of a slide to look for facets: none where it hardly goes along the surface."""
    away = dot(slide, normal)
    length = math.sqrt(max(dot(slide, slide) - away * away, 0.0))
    return min(1 + int(length / STRIDE_M), MOST_PLACES) if length > LEAST_SLIDE_M else 0


@kernel
def is_met_first(pairs: ContactPairs, start: int, way: Vector, contact: tuple[float, Vector]) -> bool:
    """Return whether after this way a facet with this gap there, and normal, is deeper than pairs from ``start`` on.

    What lies ahead cannot overlap yet: a plane that seems to is that of a facet round a corner, which is not there
    where the body is.
    """
    gap, normal = contact
    least = 0.0
    for place in range(start, pairs.count):
        least = min(least, pairs.gap_m[place] + dot(way, row(pairs.normal, place)))
    return bool(gap < least - ALIKE_M and gap - dot(way, normal) > 0.0)
