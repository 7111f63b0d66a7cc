r"""A Newton step on the contact laws, for the force components of all closed contacts together.

Each component that the law leaves free is an unknown with two directions: along *test* the motion has to vanish, along
*column* the force changes.

- Pressed normals, and all three axes of sticking or held contacts: both directions are the axis itself.
- Normals of sliding contacts: friction changes with the normal force, so the column is :math:`(1, \mu \hat t)`.
- Sliding contacts also rotate their friction. On the edge of the disk :math:`u = -\lambda f` with :math:`|f| = r`, so
  both directions are the tangent across f, along which the motion is :math:`-\lambda` times the change of the force:
  this adds :math:`\lambda` to the diagonal.

The matrix is the exact derivative of the laws while no contact changes its state (open, sticking or sliding), so the
step converges quadratically near the solution. Sweeps between the steps find the states. If a state changes within a
step, the step is valid up to that point (`feasible_step_length`), as in active-set methods for quadratic programs
(Nocedal and Wright, "Numerical Optimization", 16.5).
"""

from __future__ import annotations

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.contact.admissible import add_unknowns, project, step_to_bounds
from services.mechanics.contact.dense import solve_dense
from services.mechanics.contact.problem import ContactProblem, Unknowns


@kernel
def list_unknowns(problem: ContactProblem, out: Unknowns) -> int:
    """Write the unknowns of all contacts in their present states into ``out``, and return their number."""
    n, rows = 0, problem.rows
    for block in range(rows.n_contacts):
        n = add_unknowns(problem, block, out, n)
    return n


@kernel
def newton_step(problem: ContactProblem, W: FloatArray, unknowns: Unknowns, n: int) -> bool:
    """Write the change of the n unknowns into ``unknowns.step``, in N; return False if the matrix is singular."""
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
def feasible_step_length(problem: ContactProblem, unknowns: Unknowns, n: int, change: FloatArray) -> float:
    """Return the largest fraction of the step, at most 1, at which no contact opens or slips.

    ``change`` (k, 3) takes the change of the forces over the whole step, in N.
    """
    rows, fraction = problem.rows, 1.0
    for block in range(rows.n_contacts):
        change[block, 0] = change[block, 1] = change[block, 2] = 0.0
    for i in range(n):
        for axis in range(3):
            change[unknowns.block[i], axis] += unknowns.step[i] * unknowns.column[i, axis]
    for block in range(rows.n_contacts):
        full_change = change[block, 0], change[block, 1], change[block, 2]
        fraction = min(fraction, step_to_bounds(rows, block, full_change))
    return fraction


@kernel
def add_step(problem: ContactProblem, unknowns: Unknowns, n: int, fraction: float) -> None:
    """Add a fraction of the step to the forces, and project the force of every contact into the set of its law."""
    rows = problem.rows
    for i in range(n):
        block = unknowns.block[i]
        for axis in range(3):
            rows.force_n[block, axis] += fraction * unknowns.step[i] * unknowns.column[i, axis]
    for block in range(rows.n_contacts):
        project(rows, block)
