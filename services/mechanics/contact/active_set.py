"""A Newton step on the contact law: the rows that are closed now, solved together instead of one after another."""

from __future__ import annotations

import math

from services.mechanics.kernel import ByteArray, FloatArray, IntArray, kernel

UNILATERAL, HOLD, FILM = 0, 1, 2
# The block solves put a sliding force on its limit to rounding; anything closer than this is on it.
ON_THE_LIMIT = 1.0 - 1e-9


@kernel
def list_closed(kind: ByteArray, limit: FloatArray, force: FloatArray, rows: IntArray) -> int:
    """Fill ``rows`` with those that do not move in the present state, and return how many.

    Pressed normals; the tangents of those that stick; the three rows of a hold that does not slip.
    """
    n = 0
    for block in range(kind.shape[0]):
        row = 3 * block
        tangent = math.hypot(force[row + 1], force[row + 2])
        if kind[block] == UNILATERAL:
            if force[row] <= 0.0:
                continue
            rows[n] = row
            n += 1
            sticks = limit[block] > 0.0 and tangent < ON_THE_LIMIT * limit[block] * force[row]
        else:
            sticks = limit[block] > 0.0 and math.hypot(force[row], tangent) < ON_THE_LIMIT * limit[block]
            if sticks:
                rows[n] = row
                n += 1
        if sticks:
            rows[n] = row + 1
            rows[n + 1] = row + 2
            n += 2
    return n


@kernel
def closed_step(
    W: FloatArray,
    motion: FloatArray,
    kind: ByteArray,
    limit: FloatArray,
    force: FloatArray,
    rows: IntArray,
    matrix: FloatArray,
    step: FloatArray,
) -> bool:
    r"""Write the change of the forces on ``rows`` (n,) that brings their motion to zero into ``step`` (n,).

    A sliding contact keeps its direction: its friction changes with its normal force, which puts
    :math:`\mu W_{rt} \hat t` into the column of the normal and makes the matrix unsymmetric. ``matrix`` (n, n) is
    scratch. False where the matrix is singular.
    """
    n = rows.shape[0]
    for i in range(n):
        step[i] = -motion[rows[i]]
        for j in range(n):
            matrix[i, j] = W[rows[i], rows[j]]
    for j in range(n):
        row, block = rows[j], rows[j] // 3
        if row % 3 != 0 or kind[block] != UNILATERAL or (j + 1 < n and rows[j + 1] == row + 1):
            continue
        tangent = math.hypot(force[row + 1], force[row + 2])
        if tangent > 0.0:
            t_1, t_2 = limit[block] * force[row + 1] / tangent, limit[block] * force[row + 2] / tangent
            for i in range(n):
                matrix[i, j] += t_1 * W[rows[i], row + 1] + t_2 * W[rows[i], row + 2]
    solved: bool = solve_dense(matrix, step)
    return solved


@kernel
def solve_dense(A: FloatArray, b: FloatArray) -> bool:
    """Solve A x = b in place of b by elimination with row pivots, destroying A; False where A is singular."""
    n = b.shape[0]
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[pivot, k]):
                pivot = i
        if A[pivot, k] == 0.0:
            return False
        if pivot != k:
            for j in range(k, n):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
            b[k], b[pivot] = b[pivot], b[k]
        inverse = 1.0 / A[k, k]
        for i in range(k + 1, n):
            factor = A[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, n):
                    A[i, j] -= factor * A[k, j]
                b[i] -= factor * b[k]
    for k in range(n - 1, -1, -1):
        total = b[k]
        for j in range(k + 1, n):
            total -= A[k, j] * b[j]
        b[k] = total / A[k, k]
    return True


@kernel
def add_step(kind: ByteArray, limit: FloatArray, force: FloatArray, rows: IntArray, step: FloatArray) -> None:
    """Add the step to the forces and put every block back into its cone or ball."""
    for i in range(rows.shape[0]):
        row, block = rows[i], rows[i] // 3
        slides = kind[block] == UNILATERAL and row % 3 == 0 and not (i + 1 < rows.shape[0] and rows[i + 1] == row + 1)
        if slides and force[row] > 0.0:
            scale = max(force[row] + step[i], 0.0) / force[row]
            force[row + 1] *= scale
            force[row + 2] *= scale
        force[row] += step[i]
    for block in range(kind.shape[0]):
        row = 3 * block
        if kind[block] == UNILATERAL:
            force[row] = max(force[row], 0.0)
            radius = limit[block] * force[row]
            norm = math.hypot(force[row + 1], force[row + 2])
        else:
            radius = limit[block]
            norm = math.sqrt(force[row] ** 2 + force[row + 1] ** 2 + force[row + 2] ** 2)
        if norm > radius:
            if kind[block] != UNILATERAL:
                force[row] *= radius / norm
            force[row + 1] *= radius / norm
            force[row + 2] *= radius / norm
