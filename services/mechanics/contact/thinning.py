"""Fewer points at which the catheter touches the wall: what a rung of the quality ladder may give up for time."""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.pairs import DUCT_TRIANGLE, NO_TOOL, ContactPairs, pairs_at
from services.mechanics.collision.writer import copy_pair
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.compiled.vectors import Vector, along, dot, row, row_of, scaled

Rod = tuple[FloatArray, FloatArray, FloatArray, FloatArray]

DEEP_M = 0.05e-3
"""Who would be deeper than this at the end of the step is asked whether it touches, whatever its number."""


@kernel
def thin_pairs(address: Address[ContactPairs], rod: Rod, keep: tuple[int, int], dt_s: float) -> None:
    """Keep, of the catheter's pairs with the wall, those of every so many-th particle from the tip on, and what bears.

    Detection has looked at all of them, so that it goes on knowing on which side of the wall each is. Of the others one
    is kept that would be deeper than `DEEP_M` at the end of this step as it moves now, alone or with the wall that
    comes to it, or as the force of the last step would move it were it not borne: a rung that gives up contacts gives
    up those that are near, and those that bear a few times a particle's weight.

    Parameters
    ----------
    address : of ContactPairs
    rod : (n, 3), (n, 2, 3), (n, 3), (n,) float64
        The particles' velocities in m/s, how far in m they went in the last step against the walls that they were
        closest to, the contact forces on them of that step in N, and their masses in kg.
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
def _is_needed(pairs: ContactPairs, pair: int, rod: Rod, dt_s: float) -> bool:
    """Whether a pair is needed, by what moves its point and what it bears: on an edge that is between two particles."""
    velocity, against, force, mass = rod
    first, s, normal = pairs.particle[pair], pairs.tool_parameter[pair], row(pairs.normal, pair)
    second = min(first + 1, mass.shape[0] - 1)
    nearer_m = max(-dt_s * dot(_between(row(velocity, first), row(velocity, second), s), normal), 0.0)
    for minimum in range(against.shape[1]):
        went = _between(row_of(against, first, minimum), row_of(against, second, minimum), s)
        nearer_m = max(nearer_m, -dot(went, normal))
    borne = _between(scaled(row(force, first), 1.0 / mass[first]), scaled(row(force, second), 1.0 / mass[second]), s)
    borne_m = dt_s**2 * math.sqrt(dot(borne, borne))
    is_needed: bool = borne_m > DEEP_M or pairs.gap_m[pair] - nearer_m < -DEEP_M
    return is_needed


@kernel
def _between(first: Vector, second: Vector, s: float) -> Vector:
    return along(scaled(first, 1.0 - s), second, s)
