"""The contact problem of a step, and the work space of its solve."""

from __future__ import annotations

from typing import Annotated

from trocar.services.mechanics.arrays import BoolArray, ByteArray, FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.compiled.vectors import Vector
from trocar.services.mechanics.contact.rows import ContactRows

#: Block products of a solve without a bound: more than a day's. With an infinite number no part could be set aside.
UNBOUNDED = 1e15


class ContactProblem(Struct):
    """The complementarity problem of k contacts in contact space, with a normal and two tangents for each contact.

    Functions that need the Delassus operator W (3 k, 3 k), in m/N and symmetric positive definite, take it separately.
    There is room for c contacts, with m = 3 c axes and as many unknowns of a Newton step, see `newton`.
    """

    rows: ContactRows
    motion: Annotated[FloatArray, "m"]  # gaps and slips at the end of the step with the present forces, in m
    change: Annotated[FloatArray, 3]  # of a contact's force in the last relaxation, in N
    changed_n: Annotated[FloatArray, "c"]  # largest change of a component of each contact's force in the last sweep
    island: Annotated[IntArray, "c"]  # first contact of the island of each, see `islands`
    is_settled: Annotated[BoolArray, "c"]  # whether a Newton step may leave it out
    free: Annotated[FloatArray, "m"]  # motion without contact forces
    begun_n: Annotated[FloatArray, "c", 3]  # forces before a step
    first_n: Annotated[FloatArray, "c", 3]  # forces that the solve began with
    block: Annotated[IntArray, "m"]  # contact of each unknown
    test: Annotated[FloatArray, "m", 3]
    column: Annotated[FloatArray, "m", 3]
    shift: Annotated[FloatArray, "m"]  # lambda, added to the diagonal
    matrix: Annotated[FloatArray, "m * m"]  # by columns, or its factors
    pivots: Annotated[IntArray, "m"]
    along: Annotated[FloatArray, "m"]  # scratch
    full: Annotated[FloatArray, "m"]  # Newton step of each unknown, N
    moved: Annotated[FloatArray, "m"]  # the part of it that has been taken
    step: Annotated[FloatArray, "m"]  # the rest, see `active_set`
    force_change: Annotated[FloatArray, "c", 3]  # over the rest, in N
    bound: Annotated[ByteArray, "c"]  # what bounds the force of each contact in the rest
    response: Annotated[FloatArray, "m * m"]  # step per unit of each equation's residual
    has_response: Annotated[BoolArray, "m"]
    first: Annotated[IntArray, "m"]  # of the three unknowns that a constraint has weights on
    constraint: Annotated[FloatArray, "m", 3]  # these weights
    replaced: Annotated[FloatArray, "m", 3]  # weights on the equations that it replaces
    residual: Annotated[FloatArray, "m"]  # of these
    schur: Annotated[FloatArray, "m * m"]
    schur_pivots: Annotated[IntArray, "m"]
    lowest_j: float = 0.0  # lowest potential of this solve
    is_cut: bool = False  # whether the last solve has ended for want of work: rows may end too deep
    cycles: bool = False  # whether Coulomb's law has led in circles in this part of a step
    products_left: float = UNBOUNDED  # block products (3 x 3) that solves may still take, see `sweeps`

    @classmethod
    def of(cls, rows: ContactRows) -> ContactProblem:
        """Return the problem of these rows, with room for as many as they have."""
        m = 3 * rows.capacity
        return cls.zeros(rows=rows, c=rows.capacity, m=m, **{"m * m": m * m})


@kernel
def move_by(problem: ContactProblem, W: FloatArray, block: int, force_n: Vector, is_normal_last: bool) -> None:
    """Add the motion of all rows by a force at a contact, that along its normal first or last.

    W is symmetric, so rows are used in place of columns: these loops vectorise. All three axes are one loop, which
    loads and stores the motion once.
    """
    row, motion, n = 3 * block, problem.motion, W.shape[0]
    x, y, z = force_n
    if y == 0.0 and z == 0.0:
        if x != 0.0:
            for column in range(n):
                motion[column] += W[row, column] * x
    elif is_normal_last:
        for column in range(n):
            motion[column] = motion[column] + W[row + 1, column] * y + W[row + 2, column] * z + W[row, column] * x
    else:
        for column in range(n):
            motion[column] = motion[column] + W[row, column] * x + W[row + 1, column] * y + W[row + 2, column] * z


@kernel
def add_unknown(out: ContactProblem, n: int, block: int, test: tuple[float, float, float], shift: float) -> int:
    """Add an unknown whose force changes along its test direction, and return the new number of unknowns."""
    out.block[n], out.shift[n] = block, shift
    for axis in range(3):
        out.test[n, axis] = out.column[n, axis] = test[axis]
    return n + 1
