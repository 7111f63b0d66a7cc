"""Contact pairs, which collision detection passes to the contact solver.

A pair is a *first body* (a segment of a tool, or a point of the catheter) and a *target* (a triangle of the duct, or a
segment of the catheter). The normal points from the target towards the first body.
"""

from __future__ import annotations

from typing import Annotated

from trocar.services.mechanics.arrays import ByteArray, FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.compiled.vectors import Vector, put_row, row

NO_TOOL = -1  # in the place of the number of a tool, which is at least 0
SHAFT, JAW_A, JAW_B = 0, 1, 2
DUCT_TRIANGLE, CATHETER_SEGMENT = 0, 1


class ContactPairs(Struct):
    """Contact pairs, of which the first ``count`` are valid.

    Where the catheter is the first body, the pair's point is at (1 - s) of ``particle`` and s of the next one, with s
    the ``tool_parameter``.
    """

    tool: Annotated[ByteArray, "capacity"]  # or `NO_TOOL`, where the first body is the catheter
    tool_segment: Annotated[ByteArray, "capacity"]  # `SHAFT`, `JAW_A` or `JAW_B`
    particle: Annotated[IntArray, "capacity"]  # -1 where the first body is a tool
    target_kind: Annotated[ByteArray, "capacity"]  # `DUCT_TRIANGLE` or `CATHETER_SEGMENT`
    target: Annotated[IntArray, "capacity"]  # triangle or segment
    tool_parameter: Annotated[FloatArray, "capacity"]  # on the first body's segment, 0 to 1
    target_weights: Annotated[FloatArray, "capacity", 3]  # barycentric; (1 - s, s, 0) on a segment
    normal: Annotated[FloatArray, "capacity", 3]  # unit vector from the target towards the first body
    gap_m: Annotated[FloatArray, "capacity"]  # distance of the surfaces, negative if they overlap
    count: int = 0
    dropped: int = 0  # pairs lost in this tick for lack of room

    def clear(self) -> None:
        """Remove every pair."""
        self.put_zero("count", "dropped")


pairs_at = reader(ContactPairs)

Pair = tuple[int, int, int, int, int, float, Vector]
"""(tool, tool segment, particle, kind of target, target, place on the first body, weights in the target)."""


@kernel
def append_copies(pairs_address: Address[ContactPairs], source_address: Address[ContactPairs]) -> None:
    """Append the pairs of another list, as many as there is room for."""
    pairs, source = pairs_at(pairs_address), pairs_at(source_address)
    for k in range(min(source.count, pairs.gap_m.shape[0] - pairs.count)):
        _copy_pair(source, k, pairs, pairs.count)
        pairs.count += 1


@kernel
def _copy_pair(source: ContactPairs, k: int, out: ContactPairs, at: int) -> None:
    """Copy pair k of a list to place ``at`` of another."""
    out.tool[at], out.tool_segment[at], out.particle[at] = source.tool[k], source.tool_segment[k], source.particle[k]
    out.target_kind[at], out.target[at] = source.target_kind[k], source.target[k]
    out.tool_parameter[at], out.gap_m[at] = source.tool_parameter[k], source.gap_m[k]
    put_row(out.target_weights, at, row(source.target_weights, k))
    put_row(out.normal, at, row(source.normal, k))


@kernel
def write_pair(pairs: ContactPairs, pair: Pair, gap_m: float, normal: Vector) -> None:
    """Append a pair, or count it as dropped."""
    place = pairs.count
    if place == pairs.gap_m.shape[0]:
        pairs.dropped += 1
        return
    pairs.count = place + 1
    pairs.tool[place], pairs.tool_segment[place], pairs.particle[place] = pair[0], pair[1], pair[2]
    pairs.target_kind[place], pairs.target[place], pairs.tool_parameter[place] = pair[3], pair[4], pair[5]
    put_row(pairs.target_weights, place, pair[6])
    put_row(pairs.normal, place, normal)
    pairs.gap_m[place] = gap_m
