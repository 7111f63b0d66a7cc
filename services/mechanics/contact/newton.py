r"""A Newton step on the contact law: all closed contacts are solved together instead of one block after another.

Every degree of freedom that the law leaves to a block's force is an unknown with a *test* direction, along which the
motion has to vanish, and a *column* direction, along which the force changes:

- a pressed normal, and the three axes of what sticks or is held: the axis itself;
- the normal of a sliding contact: its friction changes with it, so the column is :math:`(1, \mu \hat t)`;
- what slides on the edge of its disk, :math:`u = -\lambda f` with :math:`|f| = r`: the directions across f. There
  the motion along the unknown is :math:`-\lambda` times the force's change, which adds :math:`\lambda` to the diagonal.

This is the exact derivative of the law while no contact changes between open, sticking and sliding, so near the
solution the step converges quadratically. The sweeps in between find the states of the contacts. If a contact changes
its state within the step, the step is valid up to there (`room_for_step`), as in active-set methods for quadratic
programs (Nocedal and Wright, "Numerical Optimization", 16.5).
"""

from __future__ import annotations

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.admissible import add_unknowns, project, room
from services.mechanics.contact.dense import solve_dense
from services.mechanics.contact.problem import ContactProblem, Unknowns


@kernel
def list_unknowns(problem: ContactProblem, out: Unknowns) -> int:
    """List the unknowns of all contacts in their present states in ``out``, and return their number."""
    n, rows = 0, problem.rows
    for block in range(rows.n_contacts):
        n = add_unknowns(problem, block, out, n)
    return n


@kernel
def newton_step(problem: ContactProblem, W: FloatArray, unknowns: Unknowns, n: int) -> bool:
    """Write the change of each of the n unknowns into ``unknowns.step``; return False if the matrix is singular."""
    motion = problem.motion
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
def room_for_step(problem: ContactProblem, unknowns: Unknowns, n: int, change: FloatArray) -> float:
    """Return the largest share of the step, at most 1, at which no contact opens or slips.

    ``change`` (k, 3) takes the change of the forces over the whole step, in N.
    """
    rows, share = problem.rows, 1.0
    for block in range(rows.n_contacts):
        change[block, 0] = change[block, 1] = change[block, 2] = 0.0
    for i in range(n):
        for axis in range(3):
            change[unknowns.block[i], axis] += unknowns.step[i] * unknowns.column[i, axis]
    for block in range(rows.n_contacts):
        whole = change[block, 0], change[block, 1], change[block, 2]
        share = min(share, room(rows, block, whole))
    return share


@kernel
def add_step(problem: ContactProblem, unknowns: Unknowns, n: int, share: float) -> None:
    """Add a share of the step to the forces, and project the force of every contact into its law's set."""
    rows = problem.rows
    for i in range(n):
        block = unknowns.block[i]
        for axis in range(3):
            rows.force_n[block, axis] += share * unknowns.step[i] * unknowns.column[i, axis]
    for block in range(rows.n_contacts):
        project(rows, block)
