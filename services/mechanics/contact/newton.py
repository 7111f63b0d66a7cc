r"""The Newton step of a contact solve, for the contacts' present states (open, sticking or sliding).

It solves the laws of all closed contacts together. Each component that the law leaves free is an unknown with two
directions: along *test* the motion has to vanish, along *column* the force changes.

- Pressed normals, and all three axes of sticking or held contacts: both directions are the axis itself.
- Normals of sliding contacts: friction changes with the normal force, so the column is :math:`(1, \mu \hat t)`.
- Sliding contacts also rotate their friction. On the edge of the disk :math:`u = -\lambda f` with :math:`|f| = r`, so
  both directions are the tangent across f, along which the motion is :math:`-\lambda` times the change of the force:
  this adds :math:`\lambda` to the diagonal.

The matrix is the exact derivative of the laws while no contact changes its state, so the step converges quadratically
near the solution. `active_set` takes it. Where friction wedges bodies it may point away from the solution: pressing and
sliding together push surfaces apart, and contacts open that sweeps close again. Once friction is bounded by a given
pressure (`solver`), both directions are the same: the matrix is symmetric and positive definite, and the potential
falls until a contact opens or slips.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.dense import factorise, solve_factorised
from trocar.services.mechanics.compiled.vectors import dot
from trocar.services.mechanics.compiled.vectors import row as vector
from trocar.services.mechanics.contact.admissible import add_unknowns
from trocar.services.mechanics.contact.problem import ContactProblem


@kernel
def list_unknowns(problem: ContactProblem) -> int:
    """Write the unknowns of all contacts that are not settled, in their present states, and return their number."""
    n = 0
    for block in range(problem.rows.n_contacts):
        if not problem.is_settled[block]:
            n = add_unknowns(problem, block, n)
    return n


@kernel
def n_unknowns_of(problem: ContactProblem, i: int, n: int) -> int:
    """Return the number of unknowns of the contact whose first one is i, of n in all."""
    count = 1
    while i + count < n and problem.block[i + count] == problem.block[i]:
        count += 1
    return count


@kernel
def solve_newton_step(problem: ContactProblem, W: FloatArray, n: int) -> bool:
    """Write the change of the n unknowns into ``full`` and ``step``, in N.

    Return False if the matrix is singular, or if there is not enough work left for it.
    """
    if not can_pay(problem, products_of_step(n, problem.rows.n_contacts)):
        return False
    motion, test, column, full = problem.motion, problem.test, problem.column, problem.full
    A, along = problem.matrix[: n * n].reshape(n, n), problem.along[: W.shape[0]]
    for j in range(n):
        row = 3 * problem.block[j]
        full[j] = -dot(vector(test, j), (motion[row], motion[row + 1], motion[row + 2]))
        x, y, z = column[j, 0], column[j, 1], column[j, 2]
        first, second, third = W[row], W[row + 1], W[row + 2]  # in place of columns, because W is symmetric
        for i in range(along.shape[0]):
            along[i] = x * first[i] + y * second[i] + z * third[i]
        for i in range(n):
            at = 3 * problem.block[i]
            A[j, i] = test[i, 0] * along[at] + test[i, 1] * along[at + 1] + test[i, 2] * along[at + 2]
        A[j, j] += problem.shift[j]
    if not factorise(A, problem.pivots):
        return False
    solve_factorised(A, problem.pivots, full[:n])
    for i in range(n):
        problem.step[i], problem.moved[i], problem.has_response[i] = full[i], 0.0, False
    return True


@kernel
def complete_response(problem: ContactProblem, n: int, equation: int) -> bool:
    """Solve for the step per unit of an equation's residual, unless that has been done since the factorisation.

    Return False if there is not enough work left for it.
    """
    if not problem.has_response[equation]:
        if not can_pay(problem, n * n / 9.0):
            return False
        response = problem.response[equation * n : equation * n + n]
        response[:], problem.has_response[equation] = 0.0, True
        response[equation] = 1.0
        solve_factorised(problem.matrix[: n * n].reshape(n, n), problem.pivots, response)
    return True


@inlined_kernel
def products_of_factors(n: int) -> float:
    """Return how many block products the factors of a matrix (n, n) take the time of: n^3 / 27, at twice the rate.

    They need not wait for each other.
    """
    return float(n) ** 3 / 54.0


@kernel
def products_of_step(n: int, k: int) -> float:
    """Return how many block products a Newton step of n unknowns among k contacts takes: its matrix and factors."""
    return float(n) * k + n * n / 3.0 + products_of_factors(n)


@kernel
def can_pay(problem: ContactProblem, products: float) -> bool:
    """Charge the work of an operation, unless less is left; return whether it is paid."""
    if problem.products_left < products:
        return False
    problem.products_left -= products
    return True


@kernel
def cost_in_sweeps(n: int, k: int) -> int:
    """Return the cost of a Newton step of n unknowns among k contacts: n^3 / 3 products to the 9 k^2 of a sweep.

    They take half the time, because they need not wait for each other.
    """
    return int(1 + n**3 // (54 * k * k))
