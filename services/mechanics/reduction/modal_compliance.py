"""The modes' part of the compliance between contact points, from their rows of the modes."""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel, summing_kernel
from trocar.services.mechanics.reduction.coincident_points import is_copied

Row = tuple[float, float, float]
Block = tuple[Row, Row, Row]


@summing_kernel
def add_modal_compliance(
    modes: FloatArray, gain: FloatArray, scratch: FloatArray, out: FloatArray, source: IntArray, from_point: int
) -> None:
    """Add modes diag(gain) modes^T to the lower blocks of ``out`` (m, m), with the first modes of ``modes`` (m, r).

    From a point on: the blocks between those before it stay as they are.
    As many modes as ``gain`` (s,) has count; ``scratch`` holds at least m s items; blocks that ``source`` (m / 3,) says
    are copies are left out, see `coincident_points`. Twice as fast as a product of the
    BLAS, because only the lower half is formed and nine sums at a time stay in registers.
    """
    n_modes, n_rows = gain.shape[0], out.shape[0]
    for row in range(3 * from_point, n_rows):
        for mode in range(n_modes):
            scratch[row * n_modes + mode] = modes[row, mode] * gain[mode]
    for a in range(3 * from_point, n_rows, 3):
        for b in range(0, a + 1, 3):
            if is_copied(source, a // 3, b // 3):
                continue
            xx, xy, xz, yx, yy, yz, zx, zy, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for mode in range(n_modes):
                x, y, z = modes[b, mode], modes[b + 1, mode], modes[b + 2, mode]
                scaled = scratch[a * n_modes + mode]
                xx, xy, xz = xx + scaled * x, xy + scaled * y, xz + scaled * z
                scaled = scratch[(a + 1) * n_modes + mode]
                yx, yy, yz = yx + scaled * x, yy + scaled * y, yz + scaled * z
                scaled = scratch[(a + 2) * n_modes + mode]
                zx, zy, zz = zx + scaled * x, zy + scaled * y, zz + scaled * z
            _add_rows(out, a, b, ((xx, xy, xz), (yx, yy, yz), (zx, zy, zz)))


@kernel
def _add_rows(out: FloatArray, row: int, column: int, block: Block) -> None:
    for i in range(3):
        for j in range(3):
            out[row + i, column + j] += block[i][j]
