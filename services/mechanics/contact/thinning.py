"""Fewer points at which the catheter touches the wall: what a rung of the quality ladder may give up for time."""

from __future__ import annotations

from services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs, pairs_at
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address

DEEP_M = 0.2e-3
"""What overlaps by more touches whatever its number: between two particles that touch, a third may sink in so far."""


@kernel
def thin_pairs(address: Address[ContactPairs], every: int, tip: int) -> None:
    """Keep, of the catheter's pairs with the wall, those of every so many-th particle from the ``tip`` on.

    Detection has looked at all of them, so that it goes on knowing on which side of the wall each is.
    """
    pairs, kept = pairs_at(address), 0
    for pair in range(pairs.count):
        on_wall = pairs.tool[pair] == NO_TOOL and pairs.target_kind[pair] == DUCT_TRIANGLE
        if on_wall and (tip - pairs.particle[pair]) % every != 0 and pairs.gap_m[pair] > -DEEP_M:
            continue
        if kept < pair:
            _move(pairs, pair, kept)
        kept += 1
    pairs.count = kept


@kernel
def _move(pairs: ContactPairs, source: int, to: int) -> None:
    pairs.tool[to], pairs.tool_segment[to] = pairs.tool[source], pairs.tool_segment[source]
    pairs.particle[to], pairs.tool_parameter[to] = pairs.particle[source], pairs.tool_parameter[source]
    pairs.target_kind[to], pairs.target[to] = pairs.target_kind[source], pairs.target[source]
    pairs.gap_m[to] = pairs.gap_m[source]
    for axis in range(3):
        pairs.target_weights[to, axis] = pairs.target_weights[source, axis]
        pairs.normal[to, axis] = pairs.normal[source, axis]
