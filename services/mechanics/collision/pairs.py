"""Candidate contact pairs, as collision detection hands them to the contact solver.

A pair is a *first body* (a segment of a tool, or a point of the catheter) against a *target* (a triangle of
the duct, or a segment of the catheter). The normal points from the target towards the first body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from services.mechanics.arrays import ByteArray, FloatArray, IntArray, LongArray
from services.mechanics.compiled import tuple_reader, tuple_table

NO_TOOL = -1
SHAFT, JAW_A, JAW_B = 0, 1, 2
DUCT_TRIANGLE, CATHETER_SEGMENT = 0, 1


class PairArrays(NamedTuple):
    """The arrays of `ContactPairs` as the contact kernels read and write them."""

    tool: ByteArray
    tool_segment: ByteArray
    particle: IntArray
    target_kind: ByteArray
    target: IntArray
    tool_parameter: FloatArray
    target_weights: FloatArray
    normal: FloatArray

    @classmethod
    def allocate(cls, capacity: int) -> PairArrays:
        """Return room for ``capacity`` pairs."""
        return cls(
            tool=np.full(capacity, NO_TOOL, np.int8),
            tool_segment=np.zeros(capacity, np.int8),
            particle=np.full(capacity, -1, np.int32),
            target_kind=np.zeros(capacity, np.int8),
            target=np.zeros(capacity, np.int32),
            tool_parameter=np.zeros(capacity),
            target_weights=np.zeros((capacity, 3)),
            normal=np.zeros((capacity, 3)),
        )


pairs_at = tuple_reader(PairArrays.allocate(1))


@dataclass(slots=True)
class ContactPairs:
    """Preallocated struct of arrays; only the first ``count`` rows mean anything.

    Attributes
    ----------
    count : int
        Number of pairs in use.
    dropped : int
        Pairs that found no room this tick; the deepest are kept by the writer.
    tool : (N,) int8
        0 or 1, or `NO_TOOL` where the first body is the catheter.
    tool_segment : (N,) int8
        `SHAFT`, `JAW_A` or `JAW_B`.
    particle : (N,) int32
        Catheter particle when the catheter is the first body (-1 otherwise). With ``tool_parameter`` s > 0
        the first body is the point at (1 - s) of this particle and s of the next one.
    target_kind : (N,) int8
        `DUCT_TRIANGLE` or `CATHETER_SEGMENT`.
    target : (N,) int32
        Triangle or segment index.
    tool_parameter : (N,) float64
        Place along the first body's segment, 0 at its start and 1 at its end.
    target_weights : (N, 3) float64
        Barycentric weights in the triangle; (1 - s, s, 0) on a catheter segment.
    normal : (N, 3) float64
        Unit vector from the target towards the first body: the direction in which the first body is pushed.
    gap_m : (N,) float64
        Distance between the surfaces (radii and half thickness subtracted); negative = overlap.
    arrays : PairArrays
        The same arrays but the gaps.
    table : LongArray
        What `pairs_at` reads at ``address``.
    """

    count: int
    dropped: int
    tool: ByteArray
    tool_segment: ByteArray
    particle: IntArray
    target_kind: ByteArray
    target: IntArray
    tool_parameter: FloatArray
    target_weights: FloatArray
    normal: FloatArray
    gap_m: FloatArray
    arrays: PairArrays
    table: LongArray
    address: int

    @classmethod
    def allocate(cls, capacity: int) -> ContactPairs:
        """Return an empty set with room for ``capacity`` pairs."""
        arrays = PairArrays.allocate(capacity)
        table = tuple_table(arrays)
        return cls(
            count=0,
            dropped=0,
            gap_m=np.zeros(capacity),
            arrays=arrays,
            table=table,
            address=table.ctypes.data,
            **arrays._asdict(),
        )

    @property
    def capacity(self) -> int:
        """Number of pairs there is room for."""
        return int(self.gap_m.shape[0])

    def clear(self) -> None:
        """Forget every pair."""
        self.count = 0
        self.dropped = 0
