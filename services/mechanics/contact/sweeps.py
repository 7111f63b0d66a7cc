"""Sweeps of block Gauss-Seidel over the contacts, and the motion and the residual that belong to the forces.

Work is counted in block products: of a block (3, 3) of the Delassus operator with the change of a contact's force. A
sweep over k contacts takes :math:`k^2`. Each operation of a solve charges what it takes to ``products_left``.
"""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.vectors import row as vector
from trocar.services.mechanics.contact.admissible import closed_axes, relax, slides
from trocar.services.mechanics.contact.problem import ContactProblem, move_by

#: Of the work that is left, what a solve may take if others may follow: most often none does, and what is cut short is
#: worth little. Where a wall lies on a wide catheter, one of 150 contacts and more takes 2 to 4 million of the 8 that a
#: tick has.
FIRST_SHARE = 0.75


@kernel
def sweep(problem: ContactProblem, W: FloatArray) -> tuple[float, float]:
    """Relax every contact once; return the largest change of a force component (N) and of a normal motion (m)."""
    largest_n, largest_m, rows, change = 0.0, 0.0, problem.rows, problem.change
    for block in range(rows.n_contacts):
        relax(problem, W, block)
        problem.changed_n[block] = max(abs(change[0]), abs(change[1]), abs(change[2]))
        largest_n = max(largest_n, problem.changed_n[block])
        largest_m = max(largest_m, abs(change[0]) * W[3 * block, 3 * block])
    problem.products_left -= products_of_sweep(problem)
    return largest_n, largest_m


@kernel
def products_of_sweep(problem: ContactProblem) -> float:
    """Return how many block products a sweep takes."""
    k = float(problem.rows.n_contacts)
    return k * k


@kernel
def can_sweep(problem: ContactProblem) -> bool:
    """Return whether what is left of the work is enough for a sweep."""
    return problem.products_left >= products_of_sweep(problem)


@kernel
def set_aside(problem: ContactProblem, most: float) -> float:
    """Leave a part of the work to a stage, ``most`` products at most; return what is set aside for what comes later."""
    left = problem.products_left
    problem.products_left = min(FIRST_SHARE * left, most)
    return left - problem.products_left


@kernel
def has_small_residual(problem: ContactProblem, tolerance_n: float) -> bool:
    """Return whether the forces of closed contacts are within ``tolerance_n`` of the solution."""
    is_small = True
    for block in range(problem.rows.n_contacts):
        is_small = is_small and _is_near(problem, block, tolerance_n)
    return is_small


@kernel
def _is_near(problem: ContactProblem, block: int, tolerance_n: float) -> bool:
    """Return whether the force of a contact, if it is closed, is within ``tolerance_n`` of the solution.

    A residual motion r of closed rows means a force error of at most |r| / c, with c the compliance of the surfaces,
    because no eigenvalue of W is below c. Where contacts are redundant (two jaws press on one place), only c
    determines how they share the force, and a sweep corrects a thousandth of the error.
    """
    rows, motion = problem.rows, problem.motion
    for axis in range(closed_axes(rows, block, slides(rows, block))):
        if abs(motion[3 * block + axis]) > rows.softness_m_n[block, axis] * tolerance_n:
            return False
    return True


@kernel
def is_solved(problem: ContactProblem, block: int, tolerance_n: float) -> bool:
    """Return whether the last sweep changed a contact by no more than ``tolerance_n``, and its residual is small."""
    return bool(problem.changed_n[block] <= tolerance_n and _is_near(problem, block, tolerance_n))


@kernel
def update_motion(problem: ContactProblem, W: FloatArray) -> None:
    """Write the motion u = W f + u_free (3 k,), in m."""
    motion, free = problem.motion, problem.free
    problem.products_left -= products_of_sweep(problem)
    for row in range(W.shape[0]):
        motion[row] = free[row]
    for block in range(problem.rows.n_contacts):
        move_by(problem, W, block, vector(problem.rows.force_n, block), False)
