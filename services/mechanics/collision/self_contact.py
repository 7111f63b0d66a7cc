"""Contacts of the catheter with itself."""

from __future__ import annotations

import math

from services.mechanics.arrays import FloatArray
from services.mechanics.collision.capsules import CapsuleMemory, capsules_at, meet
from services.mechanics.collision.pairs import CATHETER_SEGMENT, NO_TOOL, ContactPairs, pairs_at
from services.mechanics.collision.writer import write_pair
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.compiled.vectors import along, row, squared_distance


class SelfContactDetector:
    """Finds pairs of segments of one catheter.

    Args:
        n_particles: int
        margin_m: float. Pairs are reported from this gap on.
        n_apart: int. Segments fewer than this apart along the catheter do not meet: neighbours always touch, and a
            catheter cannot be bent sharper than about its own radius.
    """

    def __init__(self, n_particles: int, radius_m: float, margin_m: float, n_apart: int = 4) -> None:
        if n_apart < 2:
            raise ValueError(f"n_apart must be at least 2, neighbours share a particle; got {n_apart}")
        self._sizes = (2.0 * radius_m, margin_m)
        self._n_apart = n_apart
        self._shape = (n_particles, 3)
        self._memory = CapsuleMemory.zeros(m=max(n_particles - 1, 0), n=max(n_particles - 1, 0))

    def reset(self) -> None:
        """Forget the past."""
        self._memory.reset()

    def detect(self, particle_positions_m: FloatArray, pairs_out: ContactPairs) -> None:
        """Append the pairs of this tick for positions (n, 3)."""
        if particle_positions_m.shape != self._shape:
            raise ValueError(f"particle positions have shape {particle_positions_m.shape}, not {self._shape}")
        _detect(self._memory.address, particle_positions_m, self._n_apart, self._sizes, pairs_out.address)


@kernel
def _detect(
    memory_address: Address[CapsuleMemory],
    particles: FloatArray,
    n_apart: int,
    sizes: tuple[float, float],
    pairs_address: Address[ContactPairs],
) -> None:
    memory, pairs = capsules_at(memory_address), pairs_at(pairs_address)
    thickness, margin = sizes
    n = memory.active.shape[0]
    for i in range(n):
        a, b = row(particles, i), row(particles, i + 1)
        for j in range(i + n_apart, n):
            c, d = row(particles, j), row(particles, j + 1)
            half = 0.5 * (math.sqrt(squared_distance(a, b)) + math.sqrt(squared_distance(c, d)))
            # Midpoints further than both halves and the reach cannot meet.
            middles = squared_distance(along(a, b, 1.0), along(c, d, 1.0))
            if middles > 4.0 * (half + thickness + margin) ** 2:
                memory.active[i, j] = 0
                continue
            s, t, distance, normal = meet(memory, i, j, (a, b), (c, d), thickness + margin)
            # At a particle two segments meet the other: the later one of them stands for both.
            if distance - thickness < margin and (s < 1.0 or i == n - 1) and (t < 1.0 or j == n - 1):
                pair = (NO_TOOL, 0, i, CATHETER_SEGMENT, j, s, (1.0 - t, t, 0.0))
                write_pair(pairs, pair, distance - thickness, normal)
