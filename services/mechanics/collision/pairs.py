"""Contact pairs, which collision detection passes to the contact solver.

A pair is a *first body* (a segment of a tool, or a point of the catheter) and a *target* (a triangle of the duct, or a
segment of the catheter). The normal points from the target towards the first body.
"""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np

from services.mechanics.arrays import ByteArray, FloatArray, IntArray
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.struct import Struct, reader
from services.mechanics.compiled.vectors import Vector, put_row

NO_TOOL = -1
SHAFT, JAW_A, JAW_B = 0, 1, 2
DUCT_TRIANGLE, CATHETER_SEGMENT = 0, 1


class ContactPairs(Struct):
    """Arrays for contact pairs; only the first ``count`` entries of each array are valid.

    Attributes:
        count: int. Number of pairs in use.
        dropped: int. Pairs lost this tick because the arrays were full; the writer keeps the deepest.
        tool: (N,) int8. 0 or 1, or `NO_TOOL` where the first body is the catheter.
        tool_segment: (N,) int8. `SHAFT`, `JAW_A` or `JAW_B`.
        particle: (N,) int32. Catheter particle when the catheter is the first body (-1 otherwise). With
            ``tool_parameter`` s > 0 the first body is the point at (1 - s) of this particle and s of the next one.
        target_kind: (N,) int8. `DUCT_TRIANGLE` or `CATHETER_SEGMENT`.
        target: (N,) int32. Triangle or segment index.
        tool_parameter: (N,) float64. Parameter on the first body's segment, 0 at its start and 1 at its end.
        target_weights: (N, 3) float64. Barycentric weights in the triangle; (1 - s, s, 0) on a catheter segment.
        normal: (N, 3) float64. Unit vector from the target towards the first body: the direction of the normal force on
            the first body.
        gap_m: (N,) float64. Distance of the surfaces (radii and half thickness are subtracted), negative if they
            overlap.
    """

    tool: Annotated[ByteArray, "capacity"]
    tool_segment: Annotated[ByteArray, "capacity"]
    particle: Annotated[IntArray, "capacity"]
    target_kind: Annotated[ByteArray, "capacity"]
    target: Annotated[IntArray, "capacity"]
    tool_parameter: Annotated[FloatArray, "capacity"]
    target_weights: Annotated[FloatArray, "capacity", 3]
    normal: Annotated[FloatArray, "capacity", 3]
    gap_m: Annotated[FloatArray, "capacity"]
    count: int = 0
    dropped: int = 0

    @classmethod
    def allocate(cls, capacity: int) -> Self:
        """Return an empty set with room for ``capacity`` pairs."""
        tool, particle = np.full(capacity, NO_TOOL, np.int8), np.full(capacity, -1, np.int32)
        return cls.zeros(capacity=capacity, tool=tool, particle=particle)

    @property
    def capacity(self) -> int:
        """Number of pairs there is room for."""
        return int(self.gap_m.shape[0])

    def clear(self) -> None:
        """Remove every pair."""
        self.put_zero("count", "dropped")


pairs_at = reader(ContactPairs)

FULL = -1

Pair = tuple[int, int, int, int, int, float, Vector]
"""(tool, tool segment, particle, kind of target, target, place on the first body, weights in the target)."""


@kernel
def write_pair(pairs: ContactPairs, pair: Pair, gap_m: float, normal: Vector) -> int:
    """Write a pair and return its index; in full arrays it replaces the shallowest pair, if that is less deep."""
    place = _free_place(pairs, gap_m)
    if place == FULL:
        return FULL
    pairs.tool[place] = pair[0]
    pairs.tool_segment[place] = pair[1]
    pairs.particle[place] = pair[2]
    pairs.target_kind[place] = pair[3]
    pairs.target[place] = pair[4]
    pairs.tool_parameter[place] = pair[5]
    put_row(pairs.target_weights, place, pair[6])
    put_row(pairs.normal, place, normal)
    pairs.gap_m[place] = gap_m
    return place


@inlined_kernel
def _free_place(pairs: ContactPairs, gap_m: float) -> int:
    """Return the index for a new pair with this gap, or `FULL`."""
    if pairs.count < pairs.gap_m.shape[0]:
        pairs.count += 1
        return int(pairs.count - 1)
    pairs.dropped += 1
    gaps, shallowest = pairs.gap_m, FULL
    for k in range(gaps.shape[0]):
        if gaps[k] > gap_m and (shallowest == FULL or gaps[k] > gaps[shallowest]):
            shallowest = k
    return shallowest
