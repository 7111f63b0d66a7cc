"""A cache of rows of the residual compliance, in single precision, for whoever places a wall's nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, ByteArray, Float32Array, FloatArray, IntArray
from trocar.services.mechanics.reduction.residual.blocks import Residual, own_softness

#: Maximum size of the cache of residual blocks (65 MB), and of cached rows, one for each loaded node.
MAX_BLOCKS, MAX_ROWS = 1_800_000, 128


@dataclass(frozen=True, slots=True)
class CachedRows:
    """Rows of a residual between n nodes; each is filled block by block, when it is first asked for.

    A block has the same value whoever reads it, so walls of one duct may have one cache: two threads may not.

    Attributes:
        blocks: (k n, 3, 3) float32. The blocks of k rows.
        known: (k n,) int8. One if a block has been read.
        row_of: (n,) int32. The cached row of each node, -1 if there is none.
        kept: (k,) int32. The node of each cached row, -1 if the row is free.
        next_row: (1,) int32. The row that is replaced next.
        softness: (n,) float64. Square root of |R_ii|.
    """

    blocks: Float32Array
    known: ByteArray
    row_of: IntArray
    kept: IntArray
    next_row: IntArray
    softness: FloatArray

    @classmethod
    def of(cls, residual: Residual, most: int = MAX_ROWS) -> CachedRows:
        """Return a cache of ``most`` rows, fewer if the mesh is large: empty, or all of a residual stored in full."""
        n = residual.n_nodes
        is_whole = len(residual.blocks) == n * n and residual.blocks.dtype == np.float32
        k = n if is_whole else max(min(most, n, MAX_BLOCKS // n), 1)
        nodes, none = np.arange(n, dtype=np.int32), np.int32(-1)
        return cls(
            kept=nodes.copy() if is_whole else np.full(k, none),
            row_of=nodes if is_whole else np.full(n, none),
            next_row=np.zeros(1, np.int32),
            known=np.full(k * n, is_whole, np.int8),
            blocks=residual.blocks if is_whole else np.zeros((k * n, 3, 3), np.float32),
            softness=np.sqrt(own_softness(residual)),
        )

    def fields(self) -> dict[str, AnyArray]:
        """Return the arrays by name."""
        return {name: getattr(self, name) for name in self.__slots__}
