"""Assembly of the Delassus operator W = J A^-1 J^T, the compliance in contact space, from blocks of 3 x 3.

Blocks are summed along world axes, in which the bodies' compliances are given, and rotated into the contacts' frames at
the end. Only the lower triangle is built, because W is symmetric as each body's compliance is. All of it is built from
a first row on: the rows before it, to which others have been appended, have what couples them already.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray, IntArray
from trocar.services.mechanics.collision.pairs import NO_TOOL
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.vectors import Vector, dot
from trocar.services.mechanics.contact.rows import ContactRows

Block = tuple[Vector, Vector, Vector]
# The block of two rows without a common body: turned, it is what it was.
_NOTHING: Block = ((0.0, 0.0, 0.0),) * 3


@inlined_kernel
def add_rod_compliance(
    rows: ContactRows, slot: IntArray, rod: FloatArray, points: IntArray, out: FloatArray, from_row: int
) -> None:
    """Add the catheter's compliance between its p touched particles, ``rod`` (3 p, 3 p) in m/N, to ``out`` (m, m).

    ``slot`` gives each particle's place in ``rod``. ``points`` (4 C, 2) is scratch for the (row, index) of particles
    with a weight; most rows have one of four.
    """
    count = 0
    for a in range(rows.n_contacts):
        for i in range(rows.rod_node.shape[1]):
            if rows.rod_weight[a, i] != 0.0:
                points[count, 0], points[count, 1] = a, i
                count += 1
    for p in range(count):
        a, i = points[p, 0], points[p, 1]
        if a < from_row:
            continue
        first = 3 * slot[rows.rod_node[a, i]]
        for q in range(count):
            b, j = points[q, 0], points[q, 1]
            if b > a:
                break
            weight, second = rows.rod_weight[a, i] * rows.rod_weight[b, j], 3 * slot[rows.rod_node[b, j]]
            for row in range(3):
                for column in range(3):
                    out[3 * a + row, 3 * b + column] += weight * rod[first + row, second + column]


@inlined_kernel
def add_tool_compliance(rows: ContactRows, compliance: FloatArray, out: FloatArray, from_row: int) -> None:
    """Add G diag(c) G^T of each tool's contacts, with G their levers and c the couplings' ``compliance`` (2, 4)."""
    for a in range(from_row, rows.n_contacts):
        tool = rows.tool[a]
        if tool == NO_TOOL:
            continue
        c0, c1, c2, c3 = compliance[tool, 0], compliance[tool, 1], compliance[tool, 2], compliance[tool, 3]
        for i in range(3):
            lever = rows.lever[a, i]
            x, y, z, w = c0 * lever[0], c1 * lever[1], c2 * lever[2], c3 * lever[3]
            for b in range(a + 1):
                if rows.tool[b] == tool:
                    other = rows.lever[b]
                    for j in range(3):
                        total = x * other[j, 0] + y * other[j, 1] + z * other[j, 2] + w * other[j, 3]
                        out[3 * a + i, 3 * b + j] += total


@inlined_kernel
def rotate_to_contact_frames(rows: ContactRows, W: FloatArray, from_row: int) -> None:
    """Rotate the lower blocks of ``W`` (m, m) into the contacts' frames in place, mirror them, and add the softness.

    Blocks are held as tuples, in registers: with arrays the compiler would store each item before it loads the next.
    """
    for a in range(from_row, rows.n_contacts):
        for i in range(3):
            for j in range(i + 1, 3):
                W[3 * a + i, 3 * a + j] = W[3 * a + j, 3 * a + i]
        frame = _load(rows.frame[a], 0, 0)
        for b in range(a + 1):
            block = _load(W, 3 * a, 3 * b)
            if block == _NOTHING:
                _store(W, 3 * b, 3 * a, block)
                continue
            half = _rows_along(block, _load(rows.frame[b], 0, 0))
            _store(W, 3 * b, 3 * a, _rows_along(_transposed(half), frame))
        for i in range(3):
            W[3 * a + i, 3 * a + i] += rows.softness_m_n[a, i]


@kernel
def _load(array: FloatArray, row: int, column: int) -> Block:
    return (
        (array[row, column], array[row, column + 1], array[row, column + 2]),
        (array[row + 1, column], array[row + 1, column + 1], array[row + 1, column + 2]),
        (array[row + 2, column], array[row + 2, column + 1], array[row + 2, column + 2]),
    )


@inlined_kernel
def _transposed(block: Block) -> Block:
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = block
    return (xx, yx, zx), (xy, yy, zy), (xz, yz, zz)


@kernel
def _rows_along(block: Block, frame: Block) -> Block:
    """Return B F^T: each row of a block along the axes of a frame."""
    return _along(block[0], frame), _along(block[1], frame), _along(block[2], frame)


@kernel
def _along(vector: Vector, frame: Block) -> Vector:
    return dot(frame[0], vector), dot(frame[1], vector), dot(frame[2], vector)


@inlined_kernel
def _store(W: FloatArray, row: int, column: int, block: Block) -> None:
    """Write a block and, at its mirror image, its transpose."""
    for i in range(3):
        for j in range(3):
            W[row + i, column + j] = W[column + j, row + i] = block[i][j]
