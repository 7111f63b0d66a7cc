"""Whether a particle is in the lumen: it gets in and out only through an opening.

Caps over the open rims close the wall to a volume. A particle's flag follows the caps' side while a cap is the
closest part of that closed surface, and keeps its value everywhere else: pushing through the wall does not
change it. Passing a cap takes the particle through distance zero, so nobody who enters is missed, as long as
it is looked at every `STEP_M` of its way.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from services.mechanics.collision.kernel import kernel
from services.mechanics.collision.primitives import Vector, along, dot, scaled, squared_distance
from services.mechanics.collision.probes import JUMP_M
from services.mechanics.collision.search import NOTHING, Touch, closest, offset
from services.mechanics.collision.sides import surface_normal, triangle_normal
from services.mechanics.collision.surface import TRAVEL, Body, Patch, Shell
from services.mechanics.mesh import FloatArray

STEP_M = 0.25e-3
HORIZON_M = 5e-3


class Insideness(NamedTuple):
    """State of n particles with respect to the closed surface."""

    inside: npt.NDArray[np.int8]
    """(n,) one in the lumen, zero outside."""
    looked_from: FloatArray
    """(n, 3) where the caps were last looked at."""
    travel: FloatArray
    """(n,) the wall's travel then."""
    clearance: FloatArray
    """(n,) distance to the nearest cap then; negative if the particle has no past."""


def make_insideness(n: int) -> Insideness:
    """Return n particles without a past."""
    return Insideness(np.zeros(n, np.int8), np.zeros((n, 3)), np.zeros(n), np.full(n, -1.0))


@kernel
def cap_clearance(body: Body, state: Insideness, i: int, p: Vector) -> float:
    """Return a lower bound of the distance from particle i at p to the nearest cap."""
    row = state.looked_from
    moved = math.sqrt(squared_distance(p, (row[i, 0], row[i, 1], row[i, 2])))
    return state.clearance[i] - moved - (body.measure[TRAVEL] - state.travel[i])


@kernel
def follow_caps(shell: Shell, state: Insideness, i: int, start: Vector, end: Vector, guess: int) -> None:
    """Update the flag of particle i, which has moved from start to end; ``guess`` is a wall triangle near it."""
    body = shell.body
    motion = math.sqrt(squared_distance(start, end))
    if state.clearance[i] < 0.0 or motion > JUMP_M:
        _look_everywhere(shell, state, i, end)
        return
    if cap_clearance(body, state, i, end) > 0.0:
        return
    steps = 1 + int(motion / STEP_M)
    for step in range(1, steps + 1):
        part = step / steps
        here = along(scaled(start, 1.0 - part), end, part)
        if step == steps or cap_clearance(body, state, i, here) <= 0.0:
            _look(shell, state, i, here, guess)


@kernel
def _look(shell: Shell, state: Insideness, i: int, p: Vector, guess: int) -> None:
    body, wall, caps = shell.body, shell.wall, shell.caps
    cap = closest(body, caps, p, p, HORIZON_M, NOTHING)
    _note(body, state, i, p, math.sqrt(cap[1]))
    if cap[0] == NOTHING:
        return
    # An edge of the rim belongs to the wall and to the cap: nothing strictly closer means no opinion.
    if closest(body, wall, p, p, math.sqrt(cap[1]) * (1.0 + 1e-9), guess)[0] == NOTHING:
        state.inside[i] = _is_behind(body, caps, cap, p)


@kernel
def _look_everywhere(shell: Shell, state: Insideness, i: int, p: Vector) -> None:
    """Find the flag from nothing, by the closest point of the closed surface."""
    body, wall, caps = shell.body, shell.wall, shell.caps
    cap = closest(body, caps, p, p, math.inf, NOTHING)
    _note(body, state, i, p, math.sqrt(cap[1]))
    side = closest(body, wall, p, p, math.inf, NOTHING)
    if side[1] < cap[1] * (1.0 - 1e-9):
        state.inside[i] = _is_behind(body, wall, side, p)
    elif cap[1] < side[1] * (1.0 - 1e-9):
        state.inside[i] = _is_behind(body, caps, cap, p)
    else:
        normal = along(triangle_normal(body, wall, side[0]), triangle_normal(body, caps, cap[0]), 1.0)
        state.inside[i] = 1 if dot(offset(body, wall, side, p, p), normal) < 0.0 else 0


@kernel
def _is_behind(body: Body, patch: Patch, touch: Touch, p: Vector) -> int:
    return 1 if dot(offset(body, patch, touch, p, p), surface_normal(body, patch, touch)) < 0.0 else 0


@kernel
def _note(body: Body, state: Insideness, i: int, p: Vector, clearance: float) -> None:
    for axis in range(3):
        state.looked_from[i, axis] = p[axis]
    state.travel[i] = body.measure[TRAVEL]
    state.clearance[i] = clearance
