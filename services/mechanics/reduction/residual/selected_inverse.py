"""Entries of K^-1 where the factor has entries, without a solve: Takahashi, Fagan and Chen (1973).

From K = L D L^T the inverse Z obeys Z = D^-1 L^-1 + (1 - L^T) Z. Column by column from the last, every entry of Z in
the pattern of L follows from such entries alone; the work is that of a factorisation. The pattern holds every pair of
nodes that share a triangle, and the pairs that fill-in adds.

The pattern must be that of a symbolic elimination. Entries that cancel to zero, as they do on symmetric meshes, are
missing in what SuperLU hands out, so it is completed first: each column's rows go to the column of the first of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trocar.services.mechanics.arrays import BoolArray, FloatArray, IntArray
from trocar.services.mechanics.compiled import building_kernel
from trocar.services.mechanics.reduction.residual.blocks import BlockArray, find_sorted


@dataclass(frozen=True, slots=True)
class SelectedInverse:
    """Lower triangle of the inverse in the factor's order, in compressed columns with ascending rows.

    Attributes:
        place: (f,) int32. Where each unknown went in the factor's order.
        starts, rows: (f + 1,), (p,) int32
        values: (p,) float64
    """

    place: IntArray
    starts: IntArray
    rows: IntArray
    values: FloatArray

    @classmethod
    def of(cls, matrix: scipy.sparse.csc_array, factor: scipy.sparse.linalg.SuperLU) -> SelectedInverse:
        """Invert a matrix within the pattern of its symmetric factorisation; stored zeros count as pattern.

        Raises ValueError if rows and columns were permuted differently, so the factors are not those of a symmetric
        elimination.
        """
        if not np.array_equal(factor.perm_r, factor.perm_c):
            raise ValueError("the selected inverse needs factors with pivots on the diagonal")
        order = np.argsort(factor.perm_c)
        ones = scipy.sparse.csc_array((np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=matrix.shape)
        lower = factor.L.tocsc()
        pattern = scipy.sparse.tril(ones[order][:, order]) + abs(lower) + scipy.sparse.identity(len(order))
        starts, rows = complete_pattern(pattern.tocsc().indptr, pattern.tocsc().indices)
        values = spread_values(starts, rows, (lower.indptr, lower.indices, lower.data))
        inverse = invert_within_pattern(starts, rows, values, factor.U.diagonal())
        return cls(factor.perm_c.astype(np.int32), starts, rows, inverse)

    def read_blocks(self, unknown: IntArray, rows: IntArray, columns: IntArray, out: BlockArray) -> BoolArray:
        """Write K^-1 between nodes ``rows`` (b,) and ``columns`` (b,) into ``out`` (b, 3, 3) where it is known.

        ``unknown`` (n, 3) are the translations' places among the unknowns, -1 where held, which counts as rigid.
        Returns which blocks are known, (b,) bool; the others stay as they were.
        """
        known = np.zeros(len(rows), np.bool_)
        read_blocks((self.place, self.starts, self.rows, self.values), unknown, (rows, columns), out, known)
        return known


@building_kernel
def complete_pattern(starts: IntArray, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Return the pattern of L for a lower pattern by columns: starts (f + 1,) and ascending rows, diagonal first."""
    n = starts.shape[0] - 1
    out_starts, out, size = np.zeros(n + 1, np.int64), np.empty(2 * rows.shape[0], np.int32), 0
    seen = np.full(n, -1, np.int32)
    first_child, next_child = np.full(n, -1, np.int32), np.full(n, -1, np.int32)
    for j in range(n):
        if size + n > out.shape[0]:
            out = np.concatenate((out, np.empty(out.shape[0] + n, np.int32)))
        begin = size
        for p in range(starts[j], starts[j + 1]):
            if rows[p] >= j and seen[rows[p]] != j:
                seen[rows[p]] = j
                out[size] = rows[p]
                size += 1
        child = first_child[j]
        while child >= 0:
            for p in range(out_starts[child], out_starts[child + 1]):
                if out[p] > j and seen[out[p]] != j:
                    seen[out[p]] = j
                    out[size] = out[p]
                    size += 1
            child = next_child[child]
        out[begin:size] = np.sort(out[begin:size])
        out_starts[j + 1] = size
        if size > begin + 1:
            parent = out[begin + 1]
            next_child[j] = first_child[parent]
            first_child[parent] = j
    return out_starts, out[:size].copy()


@building_kernel
def spread_values(starts: IntArray, rows: IntArray, lower: tuple[IntArray, IntArray, FloatArray]) -> FloatArray:
    """Return the values of ``lower`` (column starts, rows, values) in a pattern that holds its own, zero elsewhere."""
    values, place = np.zeros(rows.shape[0]), np.zeros(starts.shape[0], np.int64)
    for j in range(starts.shape[0] - 1):
        for p in range(starts[j], starts[j + 1]):
            place[rows[p]] = p
        for p in range(lower[0][j], lower[0][j + 1]):
            values[place[lower[1][p]]] = lower[2][p]
    return values


@building_kernel
def invert_within_pattern(starts: IntArray, rows: IntArray, L: FloatArray, d: FloatArray) -> FloatArray:
    """Return Z in the pattern of L; each column's diagonal comes first."""
    n = d.shape[0]
    Z, total = np.zeros_like(L), np.zeros(n)
    place = np.full(n, -1, np.int32)  # of a row within the column at hand
    for j in range(n - 1, -1, -1):
        first, last = starts[j], starts[j + 1]
        for p in range(first + 1, last):
            place[rows[p]] = p - first
            total[p - first] = 0.0
        # total_i = sum over k of Z_ik L_kj, with Z_ik read from column min(i, k).
        for p in range(first + 1, last):
            k, mirrored = rows[p], 0.0
            for t in range(starts[k], starts[k + 1]):
                m = place[rows[t]]
                if m >= 0:
                    total[m] += Z[t] * L[p]
                    if t > starts[k]:
                        mirrored += Z[t] * L[first + m]
            total[p - first] += mirrored
        Z[first] = 1.0 / d[j]
        for p in range(first + 1, last):
            Z[p] = -total[p - first]
            Z[first] += total[p - first] * L[p]
            place[rows[p]] = -1
    return Z


@building_kernel
def read_blocks(
    inverse: tuple[IntArray, IntArray, IntArray, FloatArray],
    unknown: IntArray,
    pairs: tuple[IntArray, IntArray],
    out: BlockArray,
    known: BoolArray,
) -> None:
    """Look up the blocks of ``pairs`` and mark those of which every entry is in the pattern."""
    block = np.zeros((3, 3))
    for b in range(pairs[0].shape[0]):
        is_known = True
        for i in range(3):
            for j in range(3):
                first, second = unknown[pairs[0][b], i], unknown[pairs[1][b], j]
                block[i, j] = 0.0
                if is_known and first >= 0 and second >= 0:
                    at = find_entry(inverse, first, second)
                    is_known = at >= 0
                    if is_known:
                        block[i, j] = inverse[3][at]
        if is_known:
            known[b] = True
            for i in range(3):
                for j in range(3):
                    out[b, i, j] = block[i, j]


@building_kernel
def find_entry(inverse: tuple[IntArray, IntArray, IntArray, FloatArray], first: int, second: int) -> int:
    """Return where the entry of two unknowns lies, -1 outside the pattern."""
    place, starts, rows, _ = inverse
    row, column = max(place[first], place[second]), min(place[first], place[second])
    return int(find_sorted(rows, starts[column], starts[column + 1], row))
