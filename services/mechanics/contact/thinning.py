"""Fewer points at which the catheter touches the wall: what a rung of the quality ladder may give up for time."""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs, pairs_at
from services.mechanics.collision.writer import copy_pair
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address

DEEP_M = 0.05e-3
"""Who would be deeper than this at the end of the step is asked whether it touches, whatever its number."""


@kernel
def thin_pairs(
    address: Address[ContactPairs], rod: tuple[FloatArray, FloatArray, FloatArray], keep: tuple[int, int], dt_s: float
) -> None:
    """Keep, of the catheter's pairs with the wall, those of every so many-th particle from the tip on, and what bears.

    Detection has looked at all of them, so that it goes on knowing on which side of the wall each is. Of the others one
    is kept that would be deeper than `DEEP_M` at the end of this step as it moves now, or as the force of the last step
    would move it were it not borne: a rung that gives up contacts gives up those that are near, and those that bear
    a few times a particle's weight.

    Parameters
    ----------
    address : of ContactPairs
    rod : (n, 3), (n, 3), (n,) float64
        The particles' velocities in m/s, the contact forces on them of the last step in N, and their masses in kg.
    keep : (every, tip)
        One in how many, counted from which.
    dt_s : float
    """
    pairs, kept = pairs_at(address), 0
    for pair in range(pairs.count):
        on_wall = pairs.tool[pair] == NO_TOOL and pairs.target_kind[pair] == DUCT_TRIANGLE
        if on_wall and (keep[1] - pairs.particle[pair]) % keep[0] != 0 and not _is_needed(pairs, pair, rod, dt_s):
            continue
        if kept < pair:
            copy_pair(pairs, pair, kept)
        kept += 1
    pairs.count = kept


@kernel
def _is_needed(pairs: ContactPairs, pair: int, rod: tuple[FloatArray, FloatArray, FloatArray], dt_s: float) -> bool:
    particle, approach_m, squared_n2 = pairs.particle[pair], 0.0, 0.0
    for axis in range(3):
        approach_m -= dt_s * rod[0][particle, axis] * pairs.normal[pair, axis]
        squared_n2 += rod[1][particle, axis] ** 2
    borne_m = dt_s**2 * math.sqrt(squared_n2) / rod[2][particle]
    is_needed: bool = borne_m > DEEP_M or pairs.gap_m[pair] - max(approach_m, 0.0) < -DEEP_M
    return is_needed
