r"""A Newton step on the contact law: all that is closed now, solved together instead of one block after another.

Every degree of freedom that the law leaves to a block's force is an unknown with a *test* direction, along which the
motion has to vanish, and a *column* direction, along which the force changes:

- a pressed normal, and the three axes of what sticks or is held: the axis itself;
- the normal of a sliding contact: its friction changes with it, so the column is :math:`(1, \mu \hat t)`;
- what slides on the edge of its disk, :math:`u = -\lambda f` with :math:`|f| = r`: the directions across f. There
  the motion along the unknown is :math:`-\lambda` times the force's change, which adds :math:`\lambda` to the diagonal.

That is the exact derivative of the law while nobody changes between open, sticking and sliding: near the solution
the step converges quadratically. Who is what is found by the sweeps in between. Where somebody changes within the step,
it is good as far as that goes (`room_for_step`): so the methods of active sets for quadratic programs find who is open
(Nocedal and Wright, "Numerical Optimization", 16.5).
"""

from __future__ import annotations

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.admissible import add_unknowns, project, room
from services.mechanics.contact.dense import solve_dense
from services.mechanics.contact.problem import ContactProblem, Unknowns


@kernel
def list_unknowns(problem: ContactProblem, out: Unknowns) -> int:
    """Fill ``out`` with what can change in the present state, and return how many unknowns that is."""
    n, rows = 0, problem.rows
    for block in range(rows.n_contacts):
        n = add_unknowns(problem, block, out, n)
    return n


@kernel
def newton_step(problem: ContactProblem, W: FloatArray, unknowns: Unknowns, n: int) -> bool:
    """Write how far each of the n unknowns goes into ``unknowns.step``; False where the matrix is singular."""
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
    """Return what part of the step, 1 at most, goes before the first contact opens or slips.

    ``change`` (k, 3) takes what the whole step would change of the forces.
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
    """Add so much of the step to the forces and put every contact back into what its law admits."""
    rows = problem.rows
    for i in range(n):
        block = unknowns.block[i]
        for axis in range(3):
            rows.force_n[block, axis] += share * unknowns.step[i] * unknowns.column[i, axis]
    for block in range(rows.n_contacts):
        project(rows, block)
