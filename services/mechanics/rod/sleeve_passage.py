"""Which part of a rod is in its sleeve: the run of particles between the two segments that pass its end planes.

Found anew from the positions alone, by order along the rod: a free part that swings across a plane beside the sleeve,
or folds back along it, is not taken for the part inside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .elasticity import Vector, dot
from .model import RodModel

FloatArray = NDArray[np.float64]

# Places in the sleeve's array after its entry (3) and unit axis (3); see `supports.Sleeve.as_array`.
LENGTH = 6
STIFFNESS = 7
FRICTION = 8
SLIP_SPEED = 9
SEAL = 10
STOP_STIFFNESS = 11
LEAST_TIP = 12


class Passage(NamedTuple):
    """Particles `first` to `last` are in the sleeve; segment first - 1 passes the entry, segment last the exit.

    `has_entry`, `has_exit` say whether there are such segments: not where an end of the rod is inside.
    """

    first: int
    last: int
    has_entry: bool
    has_exit: bool


@njit(cache=True, nogil=True, fastmath=False)
def axial_position(sleeve: FloatArray, x: FloatArray, i: int) -> float:
    """Distance of particle i beyond the entry plane."""
    total = 0.0
    for c in range(3):
        total += (x[i, c] - sleeve[c]) * sleeve[3 + c]
    return total


@njit(cache=True, nogil=True, fastmath=False)
def offset_from_axis(sleeve: FloatArray, x: FloatArray, i: int, s: float) -> Vector:
    """From the axis to the point (1 - s) x_i + s x_{i+1}."""
    j = i + 1 if s > 0.0 else i
    p = (
        (1.0 - s) * x[i, 0] + s * x[j, 0] - sleeve[0],
        (1.0 - s) * x[i, 1] + s * x[j, 1] - sleeve[1],
        (1.0 - s) * x[i, 2] + s * x[j, 2] - sleeve[2],
    )
    along = p[0] * sleeve[3] + p[1] * sleeve[4] + p[2] * sleeve[5]
    return (p[0] - along * sleeve[3], p[1] - along * sleeve[4], p[2] - along * sleeve[5])


@njit(cache=True, nogil=True, fastmath=False)
def crossing(sleeve: FloatArray, x: FloatArray, i: int, plane: float) -> float:
    """Where along segment i (0 to 1) it passes an end plane; the nearer end of a segment that does not."""
    here = axial_position(sleeve, x, i)
    after = axial_position(sleeve, x, i + 1)
    if after == here:
        return 0.0
    return float(min(max((plane - here) / (after - here), 0.0), 1.0))


@njit(cache=True, nogil=True, fastmath=False)
def find_passage(sleeve: FloatArray, x: FloatArray) -> Passage:
    """The part of the rod at `x` (n, 3) that is in the sleeve.

    Of all segments that leave through the exit plane it is the one nearest to the axis, where the springs keep it: the
    energy stays continuous should another come as near. The entry is the last segment before it that comes in.
    """
    n = x.shape[0]
    start = axial_position(sleeve, x, 0)
    last = 0 if start >= sleeve[LENGTH] else n - 1
    has_exit = False
    if start < sleeve[LENGTH]:
        nearest = np.inf
        after = start
        for i in range(n - 1):
            here = after
            after = axial_position(sleeve, x, i + 1)
            if here < sleeve[LENGTH] <= after:
                o = offset_from_axis(sleeve, x, i, (sleeve[LENGTH] - here) / (after - here))
                if dot(o, o) < nearest:
                    nearest, last, has_exit = dot(o, o), i, True
    after = axial_position(sleeve, x, min(last + 1, n - 1))
    for i in range(min(last, n - 2), -1, -1):
        here = axial_position(sleeve, x, i)
        if here < 0.0 <= after:
            return Passage(i + 1, last, True, has_exit)
        after = here
    return Passage(0 if start >= 0.0 else n - 1, last, False, has_exit)


@njit(cache=True, nogil=True, fastmath=False)
def depth_weight(model: RodModel, i: int, axial: float) -> tuple[float, float]:
    """Share of the full stiffness that holds particle i at an axial position, and its derivative.

    The ends of the rod stay held where they are beyond the far plane: a stop gives way a little.
    """
    length = model.sleeve[LENGTH]
    ramp = min(model.rest_length, 0.5 * length)
    if axial < ramp and i < model.mass.shape[0] - 1:
        return max(axial, 0.0) / ramp, 1.0 / ramp if axial > 0.0 else 0.0
    if axial > length - ramp and i > 0:
        return max(length - axial, 0.0) / ramp, -1.0 / ramp if axial < length else 0.0
    return 1.0, 0.0


@njit(cache=True, nogil=True, fastmath=False)
def stop_overlap(model: RodModel, x: FloatArray, passage: Passage) -> tuple[int, float]:
    """The particle that is beyond a stop and by how far, towards the exit positive; (0, 0.0) where there is none.

    The first particle stops two segments (at most half the sleeve) before the exit, and the particle `least_tip_m`
    before the tip stops at the exit. Both are the ends of what may slide: a rod can leave its sleeve on neither side.
    """
    length = model.sleeve[LENGTH]
    n = x.shape[0]
    if not passage.has_entry and passage.first == 0:
        over = axial_position(model.sleeve, x, 0) - (length - min(2.0 * model.rest_length, 0.5 * length))
        if over > 0.0:
            return 0, over
    bead = max(n - 1 - int(np.ceil(model.sleeve[LEAST_TIP] / model.rest_length)), 0)
    if passage.last >= bead:
        short = axial_position(model.sleeve, x, bead) - length
        if short < 0.0:
            return bead, short
    return 0, 0.0
