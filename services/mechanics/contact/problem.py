"""The contact problem of a step, and the work space of its solve."""

from __future__ import annotations

from typing import Annotated

from trocar.services.mechanics.arrays import BoolArray, ByteArray, FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.contact.rows import ContactRows


class ContactProblem(Struct):
    """The complementarity problem of k contacts in contact space, with a normal and two tangents for each contact.

    Functions that need the Delassus operator W (3 k, 3 k), in m/N and symmetric positive definite, take it separately.
    There is room for c contacts, with m = 3 c axes and as many unknowns of a Newton step, see `newton`.
    """

    rows: ContactRows
    motion: Annotated[FloatArray, "m"]  # gaps and slips at the end of the step with the present forces, in m
    change: Annotated[FloatArray, 3]  # of a contact's force in the last relaxation, in N
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

    @classmethod
    def of(cls, rows: ContactRows) -> ContactProblem:
        """Return the problem of these rows, with room for as many as they have."""
        m = 3 * rows.capacity
        return cls.zeros(rows=rows, c=rows.capacity, m=m, **{"m * m": m * m})


@kernel
def set_force(problem: ContactProblem, W: FloatArray, block: int, axis: int, force_n: float) -> None:
    """Set the force of a contact along an axis, store its change, and update the motion of all rows.

    W is symmetric, so a row is used in place of a column: this loop vectorises.
    """
    row, motion = 3 * block + axis, problem.motion
    change = force_n - problem.rows.force_n[block, axis]
    problem.rows.force_n[block, axis], problem.change[axis] = force_n, change
    if change != 0.0:
        for column in range(W.shape[0]):
            motion[column] += W[row, column] * change


@kernel
def add_unknown(out: ContactProblem, n: int, block: int, test: tuple[float, float, float], shift: float) -> int:
    """Add an unknown whose force changes along its test direction, and return the new number of unknowns."""
    out.block[n], out.shift[n] = block, shift
    for axis in range(3):
        out.test[n, axis] = out.column[n, axis] = test[axis]
    return n + 1
