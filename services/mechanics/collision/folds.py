"""What a body touches beside the closest point of a surface, where the surface folds towards it.

Seen from within, a duct is a fold at every edge of its mesh, and a deeper one where a catheter presses it outwards.
In a fold a round body rests on both flanks. A contact with the closer flank alone lets it slide without hindrance
into the other, which then is the closer one: it would be shaken between the two, deeper from tick to tick.
"""

from __future__ import annotations

from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.collision.search import NOT_FOUND, Touch, better_neighbour, touch_triangle
from services.mechanics.collision.shell import Body, Patch
from services.mechanics.collision.sides import triangle_normal
from services.mechanics.collision.topology import NO_NEIGHBOUR
from services.mechanics.compiled import kernel
from services.mechanics.compiled.vectors import Vector, dot, row

# Flanks that turn by less than 12 degrees from one to the other are one.
SAME_FLANK = 0.978


@kernel
def may_be_flank(body: Body, patch: Patch, triangle: int, normal: Vector) -> bool:
    """Return whether a triangle can push otherwise than along ``normal``: its own points another way, or it has a rim.

    What is touched within a patch pushes along normals of its triangles or between them, round a rim any way.
    """
    for edge in range(3):
        if patch.neighbour[triangle, edge] == NO_NEIGHBOUR:
            return True
    return abs(dot(triangle_normal(body, patch, triangle), normal)) <= SAME_FLANK


@kernel
def flank_on(body: Body, patch: Patch, here: int, other: int, ends: tuple[Vector, Vector], reach: float) -> Touch:
    """Return the touch on triangle ``other`` if it is a minimum of its own beside that on triangle ``here``.

    The triangle of the touch is `NOT_FOUND` if there is none within ``reach``.
    """
    if other != here:
        touch = touch_triangle(body, patch, other, ends[0], ends[1])
        is_beside = touch[1] < reach * reach and not _is_shared(patch, here, touch)
        if is_beside and better_neighbour(body, patch, touch, ends[0], ends[1])[0] == other:
            return touch
    return (NOT_FOUND, 0.0, 0.0, (1.0, 0.0, 0.0))


@kernel
def _is_shared(patch: Patch, here: int, touch: Touch) -> bool:
    """Return whether the feature touched is also one of triangle ``here``."""
    corner = patch.triangles
    for k in range(3):
        vertex = corner[touch[0], k]
        is_corner = vertex in (corner[here, 0], corner[here, 1], corner[here, 2])
        if touch[3][k] > 0.0 and not is_corner:
            return False
    return True


@kernel
def is_new_flank(pairs: ContactPairs, start: int, normal: Vector) -> bool:
    """Return whether no pair from ``start`` on pushes the same way.

    An edge or a corner is found once by each of its triangles.
    """
    is_new = True
    for index in range(start, pairs.count):
        is_new = is_new and dot(row(pairs.normal, index), normal) <= SAME_FLANK
    return is_new
