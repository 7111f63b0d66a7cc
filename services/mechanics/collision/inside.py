"""Whether a particle is in the lumen: it gets in and out only through an opening.

Caps over the open rims close the wall to a volume. A particle's flag follows the caps' side while a cap is the
closest part of that closed surface, and keeps its value everywhere else: pushing through the wall does not
change it. Passing a cap takes the particle through distance zero, so nobody who enters is missed, as long as
it is looked at every `STEP_M` of its way.
"""

from __future__ import annotations

import math

import numpy as np

from services.mechanics.collision.primitives import put, vector
from services.mechanics.collision.probes import JUMP_M
from services.mechanics.collision.search import NOTHING, Touch, closest, offset
from services.mechanics.collision.sides import surface_normal, triangle_normal
from services.mechanics.collision.surface import Body, Patch, Shell
from services.mechanics.compiled import Struct, fill, flags, floats, kernel, struct_reader, struct_type
from services.mechanics.compiled.vectors import Vector, along, dot, scaled, squared_distance

STEP_M = 0.25e-3
HORIZON_M = 5e-3


Lumen = Struct
LUMEN = struct_type(
    arrays=(
        "inside",  # (n,) int8, one in the lumen, zero outside
        "looked_from",  # (n, 3) where the caps were last looked at
        "travel",  # (n,) the wall's travel then
        "clearance",  # (n,) distance to the nearest cap then; negative without a past
    )
)
lumen_at = struct_reader(LUMEN)


class LumenState:
    """Which of n particles are in the lumen."""

    def __init__(self, n: int) -> None:
        self.inside = np.zeros(n, np.int8)
        self._clearance = np.full(n, -1.0)
        self._storage = np.zeros(1, LUMEN)
        self.address: int = self._storage.ctypes.data
        self._alive: dict[str, np.ndarray] = {"looked_from": np.zeros((n, 3)), "travel": np.zeros(n)}
        fill(self._storage[0], inside=self.inside, clearance=self._clearance, **self._alive)

    def reset(self) -> None:
        """Drop the past of every particle."""
        self._clearance.fill(-1.0)


@kernel
def cap_clearance(body: Body, lumen: Lumen, i: int, p: Vector) -> float:
    """Return a lower bound of the distance from particle i at p to the nearest cap."""
    moved = math.sqrt(squared_distance(p, vector(floats(lumen.looked_from), i)))
    left: float = floats(lumen.clearance)[i] - moved - (body.travel - floats(lumen.travel)[i])
    return left


@kernel
def follow_caps(shell: Shell, lumen: Lumen, i: int, start: Vector, end: Vector, guess: int) -> None:
    """Update the flag of particle i, which has moved from start to end; ``guess`` is a wall triangle near it."""
    body = shell.body
    motion = math.sqrt(squared_distance(start, end))
    if floats(lumen.clearance)[i] < 0.0 or motion > JUMP_M:
        _look_everywhere(shell, lumen, i, end)
        return
    if cap_clearance(body, lumen, i, end) > 0.0:
        return
    steps = 1 + int(motion / STEP_M)
    for step in range(1, steps + 1):
        part = step / steps
        here = along(scaled(start, 1.0 - part), end, part)
        if step == steps or cap_clearance(body, lumen, i, here) <= 0.0:
            _look(shell, lumen, i, here, guess)


@kernel
def _look(shell: Shell, lumen: Lumen, i: int, p: Vector, guess: int) -> None:
    body, wall, caps = shell.body, shell.wall, shell.caps
    cap = closest(body, caps, p, p, HORIZON_M, NOTHING)
    _note(body, lumen, i, p, math.sqrt(cap[1]))
    if cap[0] == NOTHING:
        return
    # An edge of the rim belongs to the wall and to the cap: nothing strictly closer means no opinion.
    if closest(body, wall, p, p, math.sqrt(cap[1]) * (1.0 + 1e-9), guess)[0] == NOTHING:
        flags(lumen.inside)[i] = _is_behind(body, caps, cap, p)


@kernel
def _look_everywhere(shell: Shell, lumen: Lumen, i: int, p: Vector) -> None:
    """Find the flag from nothing, by the closest point of the closed surface."""
    body, wall, caps = shell.body, shell.wall, shell.caps
    cap = closest(body, caps, p, p, math.inf, NOTHING)
    _note(body, lumen, i, p, math.sqrt(cap[1]))
    side = closest(body, wall, p, p, math.inf, NOTHING)
    if side[1] < cap[1] * (1.0 - 1e-9):
        flags(lumen.inside)[i] = _is_behind(body, wall, side, p)
    elif cap[1] < side[1] * (1.0 - 1e-9):
        flags(lumen.inside)[i] = _is_behind(body, caps, cap, p)
    else:
        normal = along(triangle_normal(body, wall, side[0]), triangle_normal(body, caps, cap[0]), 1.0)
        flags(lumen.inside)[i] = 1 if dot(offset(body, wall, side, p, p), normal) < 0.0 else 0


@kernel
def _is_behind(body: Body, patch: Patch, touch: Touch, p: Vector) -> int:
    return 1 if dot(offset(body, patch, touch, p, p), surface_normal(body, patch, touch)) < 0.0 else 0


@kernel
def _note(body: Body, lumen: Lumen, i: int, p: Vector, clearance: float) -> None:
    put(floats(lumen.looked_from), i, p)
    floats(lumen.travel)[i] = body.travel_noted
    floats(lumen.clearance)[i] = clearance
