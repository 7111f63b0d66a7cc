r"""Steps of a contact solve: block Gauss-Seidel sweeps, Newton steps, and an active-set method made of them.

A Newton step solves the laws of all closed contacts together. Each component that the law leaves free is an unknown
with two directions: along *test* the motion has to vanish, along *column* the force changes.

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
from services.mechanics.compiled.vectors import along, put_row
from services.mechanics.compiled.vectors import row as vector
from services.mechanics.contact.admissible import add_unknowns, closed_axes, project, relax, slides, step_to_bounds
from services.mechanics.contact.dense import solve_dense
from services.mechanics.contact.problem import ContactProblem

# Cost in sweeps after which no further step of the active-set method is taken.
MAX_ACTIVE_SET_COST = 30
# A step goes beyond the point where a contact opens or slips by this fraction, so that the contact leaves the active
# set in spite of rounding.
OVERSHOOT = 1e-9


@kernel
def list_unknowns(problem: ContactProblem) -> int:
    """Write the unknowns of all contacts in their present states, and return their number."""
    n = 0
    for block in range(problem.rows.n_contacts):
        n = add_unknowns(problem, block, n)
    return n


@kernel
def newton_step(problem: ContactProblem, W: FloatArray, n: int) -> bool:
    """Write the change of the n unknowns into ``problem.step``, in N; return False if the matrix is singular."""
    motion, test, column, step, along = problem.motion, problem.test, problem.column, problem.step, problem.along
    A = problem.matrix[: n * n].reshape(n, n)
    for i in range(n):
        row = 3 * problem.block[i]
        x, y, z = test[i, 0], test[i, 1], test[i, 2]
        step[i] = -(x * motion[row] + y * motion[row + 1] + z * motion[row + 2])
        for j in range(W.shape[0]):
            along[j] = x * W[row, j] + y * W[row + 1, j] + z * W[row + 2, j]
        for j in range(n):
            first = 3 * problem.block[j]
            A[i, j] = along[first] * column[j, 0] + along[first + 1] * column[j, 1] + along[first + 2] * column[j, 2]
        A[i, i] += problem.shift[i]
    return solve_dense(A, step[:n])


@kernel
def feasible_step_length(problem: ContactProblem, n: int) -> float:
    """Return the largest fraction of the step, at most 1, at which no contact opens or slips."""
    rows, change, fraction = problem.rows, problem.force_change, 1.0
    change[: rows.n_contacts] = 0.0
    for i in range(n):
        block = problem.block[i]
        put_row(change, block, along(vector(change, block), vector(problem.column, i), problem.step[i]))
    for block in range(rows.n_contacts):
        fraction = min(fraction, step_to_bounds(rows, block, vector(change, block)))
    return fraction


@kernel
def add_step(problem: ContactProblem, n: int, fraction: float) -> None:
    """Add a fraction of the step to the forces, and project the force of every contact into the set of its law."""
    rows = problem.rows
    for i in range(n):
        force = vector(rows.force_n, problem.block[i])
        put_row(rows.force_n, problem.block[i], along(force, vector(problem.column, i), fraction * problem.step[i]))
    for block in range(rows.n_contacts):
        project(rows, block)


@kernel
def sweep(problem: ContactProblem, W: FloatArray) -> tuple[float, float]:
    """Relax every contact once; return the largest change of a force component (N) and of a normal motion (m)."""
    largest_n, largest_m, rows, change = 0.0, 0.0, problem.rows, problem.change
    for block in range(rows.n_contacts):
        relax(problem, W, block)
        largest_n = max(largest_n, abs(change[0]), abs(change[1]), abs(change[2]))
        largest_m = max(largest_m, abs(change[0]) * W[3 * block, 3 * block])
    return largest_n, largest_m


@kernel
def has_small_residual(problem: ContactProblem, tolerance_n: float) -> bool:
    """Return whether the forces of closed contacts are within ``tolerance_n`` of the solution.

    A residual motion r of closed rows means a force error of at most |r| / c, with c the compliance of the surfaces,
    because no eigenvalue of W is below c. Where contacts are redundant (two jaws press on one place), only c
    determines how they share the force, and a sweep corrects a thousandth of the error.
    """
    rows, motion = problem.rows, problem.motion
    for block in range(rows.n_contacts):
        for axis in range(closed_axes(rows, block, slides(rows, block))):
            if abs(motion[3 * block + axis]) > rows.softness_m_n[block, axis] * tolerance_n:
                return False
    return True


@kernel
def active_set_cost(n: int, k: int) -> int:
    """Return the cost in sweeps of a step of n unknowns among k contacts, which grows with the cube of n."""
    return int(1 + n**3 // (27 * k * k))


@kernel
def take_active_set_steps(problem: ContactProblem, W: FloatArray, n: int) -> int:
    """Take Newton steps, each up to where a contact opens or slips, until a full step is feasible; return their cost.

    This is the primal active-set method (Nocedal and Wright, "Numerical Optimization", 16.5): steps remove contacts
    from the active set, and sweeps add those that are missing. A single step between sweeps would not do, because the
    sweeps close again what it has opened. With friction the solution is no minimum, and the potential need not fall.
    """
    cost, k = 0, problem.rows.n_contacts
    while True:
        fraction = feasible_step_length(problem, n)
        add_step(problem, n, min(fraction * (1.0 + OVERSHOOT), 1.0))
        update_motion(problem, W)
        cost += active_set_cost(n, k)
        if fraction >= 1.0 or cost >= MAX_ACTIVE_SET_COST:
            return cost
        n = list_unknowns(problem)
        if n == 0 or not newton_step(problem, W, n):
            return cost


@kernel
def copy_forces(source: FloatArray, target: FloatArray, count: int) -> None:
    """Copy the first ``count`` forces."""
    for block in range(count):
        put_row(target, block, vector(source, block))


@kernel
def update_motion(problem: ContactProblem, W: FloatArray) -> None:
    """Write the motion u = W f + u_free (3 k,), in m."""
    motion, free = problem.motion, problem.free
    for row in range(W.shape[0]):
        motion[row] = free[row]
    for block in range(problem.rows.n_contacts):
        for axis in range(3):
            force = problem.rows.force_n[block, axis]
            if force != 0.0:
                for column in range(W.shape[0]):
                    motion[column] += W[3 * block + axis, column] * force
