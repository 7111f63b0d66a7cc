"""Writing contact pairs; where there is no more room the deepest are kept."""

from __future__ import annotations

from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.compiled import kernel
from services.mechanics.compiled.vectors import Vector, put_row

FULL = -1

Pair = tuple[int, int, int, int, int, float, Vector]
"""(tool, tool segment, particle, kind of target, target, place on the first body, weights in the target)."""


@kernel
def write_pair(pairs: ContactPairs, pair: Pair, gap_m: float, normal: Vector) -> int:
    """Write one pair and return its place; where there is no room it replaces the shallowest, if that is shallower."""
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


@kernel
def _free_place(pairs: ContactPairs, gap_m: float) -> int:
    if pairs.count < pairs.gap_m.shape[0]:
        pairs.count += 1
        return int(pairs.count - 1)
    pairs.dropped += 1
    gaps, shallowest = pairs.gap_m, FULL
    for k in range(gaps.shape[0]):
        if gaps[k] > gap_m and (shallowest == FULL or gaps[k] > gaps[shallowest]):
            shallowest = k
    return shallowest
