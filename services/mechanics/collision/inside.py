"""Whether a particle is in the lumen: it gets in and out only through an opening.

Caps over the open rims close the wall to a volume. A particle's flag follows the caps' side while a cap is the
closest part of that closed surface, and keeps its value everywhere else: pushing through the wall does not
change it. Passing a cap takes the particle through distance zero, so nobody who enters is missed, as long as
it is looked at every `STEP_M` of its way. Nor does anybody enter who has not gone as far as to the cap and beyond
it. Where a rim is dented its cap folds over, and the closest point of a fold does not tell on which side one is; the
solid angle under which the caps are seen does, since folds cancel in it: half a sphere right behind a cap.
"""

from __future__ import annotations

import math
from typing import Annotated, Self

import numpy as np

from services.mechanics.arrays import ByteArray, FloatArray
from services.mechanics.collision.nodes import corner_positions
from services.mechanics.collision.primitives import index
from services.mechanics.collision.probes import JUMP_M
from services.mechanics.collision.search import NOT_FOUND, Touch, closest, offset
from services.mechanics.collision.shell import Body, Patch, Shell
from services.mechanics.collision.sides import surface_normal, triangle_normal
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.struct import Struct
from services.mechanics.compiled.vectors import (
    Vector,
    along,
    cross,
    dot,
    put_row,
    row,
    scaled,
    squared_distance,
    subtract,
)

STEP_M = 0.25e-3
HORIZON_M = 5e-3
# Who sees the caps from behind under less than this part of the sphere is beside them.
BEHIND = 0.125


class Lumen(Struct):
    """Which of n particles are in the lumen."""

    inside: Annotated[ByteArray, "n"]  # one in the lumen, zero outside
    looked_from: Annotated[FloatArray, "n", 3]  # where the caps were last looked at
    travel: Annotated[FloatArray, "n"]  # the wall's travel then
    clearance: Annotated[FloatArray, "n"]  # distance to the nearest cap then; negative without a past
    unsure: Annotated[ByteArray, "n"]  # one where they may have passed a cap since, and nothing has told the side

    @classmethod
    def allocate(cls, n: int) -> Self:
        """Return n particles without a past."""
        return cls.zeros(n=n, clearance=np.full(n, -1.0))

    def reset(self) -> None:
        """Drop the past of every particle."""
        self.clearance.fill(-1.0)


@kernel
def put_inside(lumen: Lumen, i: int, is_inside: bool) -> None:
    """Set the flag of a particle as the wall knows it; where that is news the caps are asked once more."""
    inside = 1 if is_inside else 0
    lumen.unsure[i] = 1 if lumen.inside[i] != inside else 0
    lumen.inside[i] = inside


@kernel
def cap_clearance(body: Body, lumen: Lumen, i: int, p: Vector) -> float:
    """Return a lower bound of the distance from particle i at p to the nearest cap."""
    moved = math.sqrt(squared_distance(p, row(lumen.looked_from, i)))
    left: float = lumen.clearance[i] - moved - (body.travel - lumen.travel[i])
    return left


@inlined_kernel
def follow_caps(shell: Shell, lumen: Lumen, i: int, start: Vector, end: Vector, guess: int) -> None:
    """Update the flag of particle i, which has moved from start to end; ``guess`` is a wall triangle near it."""
    body = shell.body
    motion = math.sqrt(squared_distance(start, end))
    if lumen.clearance[i] < 0.0 or motion > JUMP_M:
        _look_everywhere(shell, lumen, i, end)
        return
    if cap_clearance(body, lumen, i, end) > 0.0:
        return
    steps, begun = 1 + int(motion / STEP_M), start
    for step in range(1, steps + 1):
        part = step / steps
        here = along(scaled(start, 1.0 - part), end, part)
        if step == steps or cap_clearance(body, lumen, i, here) <= 0.0:
            _look(shell, lumen, i, (begun, here), guess)
            begun = here


@inlined_kernel
def _look(shell: Shell, lumen: Lumen, i: int, ends: tuple[Vector, Vector], guess: int) -> None:
    """Look at the caps from the end of a straight piece of the way since the last look."""
    body, wall, caps, (begun, p) = shell.body, shell.wall, shell.caps, ends
    gone = math.sqrt(squared_distance(begun, row(lumen.looked_from, i))) + math.sqrt(squared_distance(p, begun))
    gone += body.travel - lumen.travel[i]
    cap = closest(body, caps, p, p, HORIZON_M, index(NOT_FOUND))
    distance = math.sqrt(cap[1])
    may_have_passed = lumen.unsure[i] != 0 or gone * (1.0 + 1e-9) >= lumen.clearance[i] + distance
    _note(body, lumen, i, p, distance)
    if cap[0] == NOT_FOUND:
        lumen.unsure[i] = 0
        return
    # An edge of the rim belongs to the wall and to the cap: nothing strictly closer means no opinion.
    tells = closest(body, wall, p, p, distance * (1.0 + 1e-9), index(guess))[0] == NOT_FOUND
    if not may_have_passed:
        return
    seen = _part_of_sphere(body, caps, p) if tells else 0.0
    if seen > BEHIND or seen < 0.0:
        lumen.inside[i], lumen.unsure[i] = 1 if seen > BEHIND else 0, 0
    else:
        lumen.unsure[i] = 1


@kernel
def _part_of_sphere(body: Body, patch: Patch, p: Vector) -> float:
    """Return the part of the sphere that a patch covers as seen from p, positive where it is seen from behind.

    Van Oosterom and Strackee, "The solid angle of a plane triangle" (1983).
    """
    total = 0.0
    for triangle in range(patch.triangles.shape[0]):
        p0, p1, p2 = corner_positions(body, patch, triangle)
        a, b, c = subtract(p0, p), subtract(p1, p), subtract(p2, p)
        la, lb, lc = math.sqrt(dot(a, a)), math.sqrt(dot(b, b)), math.sqrt(dot(c, c))
        beside = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
        total += 2.0 * math.atan2(dot(a, cross(b, c)), beside)
    return total / (4.0 * math.pi)


@inlined_kernel
def _look_everywhere(shell: Shell, lumen: Lumen, i: int, p: Vector) -> None:
    """Find the flag from nothing, by the closest point of the closed surface."""
    body, wall, caps = shell.body, shell.wall, shell.caps
    cap = closest(body, caps, p, p, math.inf, index(NOT_FOUND))
    _note(body, lumen, i, p, math.sqrt(cap[1]))
    lumen.unsure[i] = 0
    side = closest(body, wall, p, p, math.inf, index(NOT_FOUND))
    if side[1] < cap[1] * (1.0 - 1e-9):
        lumen.inside[i] = _is_behind(body, wall, side, p)
    elif cap[1] < side[1] * (1.0 - 1e-9):
        lumen.inside[i] = _is_behind(body, caps, cap, p)
    else:
        normal = along(triangle_normal(body, wall, side[0]), triangle_normal(body, caps, cap[0]), 1.0)
        lumen.inside[i] = 1 if dot(offset(body, wall, side, p, p), normal) < 0.0 else 0


@kernel
def _is_behind(body: Body, patch: Patch, touch: Touch, p: Vector) -> int:
    return 1 if dot(offset(body, patch, touch, p, p), surface_normal(body, patch, touch)) < 0.0 else 0


@kernel
def _note(body: Body, lumen: Lumen, i: int, p: Vector, clearance: float) -> None:
    put_row(lumen.looked_from, i, p)
    lumen.travel[i] = body.travel_noted
    lumen.clearance[i] = clearance
