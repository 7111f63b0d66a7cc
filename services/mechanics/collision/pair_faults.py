"""What a pair that somebody else has found must be: it names what is there, and its numbers can be those of a contact.

Kernels trust a pair's numbers, so it is looked at where it comes in: an index too far would write beside an array.
"""

from __future__ import annotations

import math

from services.mechanics.arrays import IntArray
from services.mechanics.collision.pairs import ContactPairs, pairs_at
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.compiled.vectors import Vector, dot
from services.mechanics.compiled.vectors import row as row_of

N_BODIES = 2, 3
"""Tools, and segments of each."""

# What whoever found a pair may round: also in single precision, weights of a triangle seen from half a metre.
TOLERANCE = 1e-3
# No further apart: a shaft is half a metre long, and what is meant in millimetres is refused.
FURTHEST_M = 1.0

FAULTS = (
    "",
    "tool",
    "tool_segment",
    "target_kind",
    "target",
    "tool_parameter",
    "target_weights",
    "normal",
    "gap_m",
)
"""Names of the fields that may be wrong, by the number that `pair_fault` returns."""


@kernel
def names_fault(tool: int, segment: int, kind: int, target: int, n_targets: IntArray) -> int:
    """Return which of `FAULTS` keeps a tool's pair from naming what is there; ``n_targets`` (2,) by kind."""
    if not 0 <= tool < N_BODIES[0]:
        return 1
    if not 0 <= segment < N_BODIES[1]:
        return 2
    if not 0 <= kind < n_targets.shape[0]:
        return 3
    return 0 if 0 <= target < n_targets[kind] else 4


@kernel
def numbers_fault(parameter: float, weights: Vector, normal: Vector, gap_m: float) -> int:
    """Return which of `FAULTS` keeps numbers from being those of a contact. Written so that a NaN is a fault."""
    if not -TOLERANCE <= parameter <= 1.0 + TOLERANCE:
        return 5
    least, total = min(weights[0], min(weights[1], weights[2])), weights[0] + weights[1] + weights[2]
    if not (abs(total - 1.0) <= TOLERANCE and least >= -TOLERANCE):
        return 6
    if not abs(math.sqrt(dot(normal, normal)) - 1.0) <= TOLERANCE:
        return 7
    return 0 if abs(gap_m) <= FURTHEST_M else 8


@kernel
def first_fault(address: Address[ContactPairs], n_targets: IntArray) -> tuple[int, int]:
    """Return the first pair that is none of a tool's, and which of `FAULTS` it has; (0, 0) if all are sound.

    A number of pairs that there is no room for is told as (-1, 0).
    """
    pairs = pairs_at(address)
    if not 0 <= pairs.count <= pairs.gap_m.shape[0]:
        return -1, 0
    for i in range(pairs.count):
        fault = names_fault(pairs.tool[i], pairs.tool_segment[i], pairs.target_kind[i], pairs.target[i], n_targets)
        if fault == 0:
            weights, normal = row_of(pairs.target_weights, i), row_of(pairs.normal, i)
            fault = numbers_fault(pairs.tool_parameter[i], weights, normal, pairs.gap_m[i])
        if fault:
            return i, fault
    return 0, 0
