r"""A Newton step on the contact law: all that is closed now, solved together instead of one block after another.

Every degree of freedom that the law leaves to a block's force is an unknown with a *test* direction, along which the
motion has to vanish, and a *column* direction, along which the force changes:

- a pressed normal, and the three axes of what sticks or is held: the axis itself;
- the normal of a sliding contact: its friction changes with it, so the column is :math:`(1, \mu \hat t)`;
- what slides on the edge of a disk or ball, :math:`u = -\lambda f` with :math:`|f| = r`: the directions across f. There
  the motion along the unknown is :math:`-\lambda` times the force's change, which adds :math:`\lambda` to the diagonal.

That is the exact derivative of the law while nobody changes between open, sticking and sliding: near the solution
the step converges quadratically. Who is what is found by the sweeps in between.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from services.mechanics.arrays import ByteArray, FloatArray, IntArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.dense import solve_dense

UNILATERAL, HOLD, FILM = 0, 1, 2
# The block solves put a sliding force on its limit to rounding; anything closer than this is on it.
ON_THE_LIMIT = 1.0 - 1e-9


class Unknowns(NamedTuple):
    """What a Newton step solves for, at most m unknowns."""

    block: IntArray  # (m,)
    test: FloatArray  # (m, 3)
    column: FloatArray  # (m, 3)
    shift: FloatArray  # (m,) lambda
    matrix: FloatArray  # (m * m,)
    step: FloatArray  # (m,)
    along: FloatArray  # (m,) scratch

    @classmethod
    def allocate(cls, n_rows: int) -> Unknowns:
        """Return room for ``n_rows`` unknowns."""
        return cls(
            block=np.zeros(n_rows, np.int32),
            test=np.zeros((n_rows, 3)),
            column=np.zeros((n_rows, 3)),
            shift=np.zeros(n_rows),
            matrix=np.zeros(n_rows * n_rows),
            step=np.zeros(n_rows),
            along=np.zeros(n_rows),
        )


@kernel
def list_unknowns(motion: FloatArray, kind: ByteArray, limit: FloatArray, force: FloatArray, out: Unknowns) -> int:
    """Fill ``out`` with what can change in the present state, and return how many unknowns that is."""
    n = 0
    for block in range(kind.shape[0]):
        row = 3 * block
        if kind[block] != UNILATERAL:
            n = _add_hold(motion, limit[block], force, block, out, n)
        elif force[row] > 0.0:
            tangent = math.hypot(force[row + 1], force[row + 2])
            if limit[block] > 0.0 and tangent < ON_THE_LIMIT * limit[block] * force[row]:
                n = _add_axes(block, out, n)
            else:
                n = _add_sliding(motion, limit[block], force, block, out, n)
    return n


@kernel
def _add(out: Unknowns, n: int, block: int, test: tuple[float, float, float], shift: float) -> int:
    out.block[n], out.shift[n] = block, shift
    for axis in range(3):
        out.test[n, axis] = out.column[n, axis] = test[axis]
    return n + 1


@kernel
def _add_axes(block: int, out: Unknowns, n: int) -> int:
    n = _add(out, n, block, (1.0, 0.0, 0.0), 0.0)
    n = _add(out, n, block, (0.0, 1.0, 0.0), 0.0)
    return _add(out, n, block, (0.0, 0.0, 1.0), 0.0)


@kernel
def _add_sliding(motion: FloatArray, mu: float, force: FloatArray, block: int, out: Unknowns, n: int) -> int:
    row = 3 * block
    f_1, f_2 = force[row + 1], force[row + 2]
    n = _add(out, n, block, (1.0, 0.0, 0.0), 0.0)
    radius_2 = f_1 * f_1 + f_2 * f_2
    if radius_2 == 0.0:
        return n
    radius = math.sqrt(radius_2)
    out.column[n - 1, 1], out.column[n - 1, 2] = mu * f_1 / radius, mu * f_2 / radius
    shift = max(-(motion[row + 1] * f_1 + motion[row + 2] * f_2) / radius_2, 0.0)
    return _add(out, n, block, (0.0, -f_2 / radius, f_1 / radius), shift)


@kernel
def _add_hold(motion: FloatArray, limit: float, force: FloatArray, block: int, out: Unknowns, n: int) -> int:
    if limit <= 0.0:
        return n
    row = 3 * block
    x, y, z = force[row], force[row + 1], force[row + 2]
    radius_2 = x * x + y * y + z * z
    radius = math.sqrt(radius_2)
    if radius < ON_THE_LIMIT * limit:
        return _add_axes(block, out, n)
    shift = max(-(motion[row] * x + motion[row + 1] * y + motion[row + 2] * z) / radius_2, 0.0)
    x, y, z = x / radius, y / radius, z / radius
    # Two directions across f: Duff et al., JCGT 6(1), 2017.
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    n = _add(out, n, block, (1.0 + sign * x * x * a, sign * x * y * a, -sign * x), shift)
    return _add(out, n, block, (x * y * a, sign + y * y * a, -y), shift)


@kernel
def newton_step(W: FloatArray, motion: FloatArray, unknowns: Unknowns, n: int) -> bool:
    """Write how far each of the n unknowns goes into ``unknowns.step``; False where the matrix is singular."""
    test, column, step, along = unknowns.test, unknowns.column, unknowns.step, unknowns.along
    A = unknowns.matrix[: n * n].reshape(n, n)
    for i in range(n):
        row = 3 * unknowns.block[i]
        x, y, z = test[i, 0], test[i, 1], test[i, 2]
        step[i] = -(x * motion[row] + y * motion[row + 1] + z * motion[row + 2])
        for j in range(W.shape[0]):
            along[j] = x * W[row, j] + y * W[row + 1, j] + z * W[row + 2, j]
        for j in range(n):
            first = 3 * unknowns.block[j]
            A[i, j] = along[first] * column[j, 0] + along[first + 1] * column[j, 1] + along[first + 2] * column[j, 2]
        A[i, i] += unknowns.shift[i]
    solved: bool = solve_dense(A, step[:n])
    return solved


@kernel
def add_step(kind: ByteArray, limit: FloatArray, force: FloatArray, unknowns: Unknowns, n: int) -> None:
    """Add the step to the forces and put every block back into its cone or ball."""
    for i in range(n):
        row = 3 * unknowns.block[i]
        for axis in range(3):
            force[row + axis] += unknowns.step[i] * unknowns.column[i, axis]
    for block in range(kind.shape[0]):
        _project(kind[block], limit[block], force, 3 * block)


@kernel
def _project(kind: int, limit: float, force: FloatArray, row: int) -> None:
    if kind == UNILATERAL:
        force[row] = max(force[row], 0.0)
        radius = limit * force[row]
        norm = math.hypot(force[row + 1], force[row + 2])
    else:
        radius = limit
        norm = math.sqrt(force[row] ** 2 + force[row + 1] ** 2 + force[row + 2] ** 2)
    if norm > radius:
        if kind != UNILATERAL:
            force[row] *= radius / norm
        force[row + 1] *= radius / norm
        force[row + 2] *= radius / norm
