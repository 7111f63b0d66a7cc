"""Parts of a contact solve: block Gauss-Seidel sweeps, and the steps of an active-set method."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.struct import Struct
from services.mechanics.contact.admissible import closed_axes, relax, slides
from services.mechanics.contact.newton import add_step, feasible_step_length, list_unknowns, newton_step
from services.mechanics.contact.problem import ContactProblem, Unknowns

# Cost in sweeps after which no further step of the active-set method is taken.
MAX_ACTIVE_SET_COST = 30
# A step goes beyond the point where a contact opens or slips by this fraction, so that the contact leaves the active
# set in spite of rounding.
OVERSHOOT = 1e-9


class SolverScratch(Struct):
    """Work space of a solve with at most c contacts, m = 3 c rows."""

    unknowns: Unknowns
    force: Annotated[FloatArray, "c", 3]
    force_change: Annotated[FloatArray, "c", 3]  # over a full Newton step, in N
    free: Annotated[FloatArray, "m"]
    friction: Annotated[FloatArray, "c"]  # coefficients, while Tresca bounds replace them

    @classmethod
    def allocate(cls, capacity: int) -> SolverScratch:
        """Return work space for ``capacity`` contacts."""
        m = 3 * capacity
        unknowns = Unknowns.zeros(m=m, matrix=np.zeros(m * m))
        return cls.zeros(c=capacity, m=m, unknowns=unknowns)


@kernel
def sweep(problem: ContactProblem, W: FloatArray) -> tuple[float, float]:
    """Relax every contact once; return the largest change of a force component (N) and of a normal motion (m)."""
    largest_n, largest_m, rows, change = 0.0, 0.0, problem.rows, problem.change
    for block in range(rows.n_contacts):
        relax(problem, W, block)
        largest_n = max(largest_n, abs(change[0]), abs(change[1]), abs(change[2]))
        largest_m = max(largest_m, abs(change[0]) * W[3 * block, 3 * block])
    return largest_n, largest_m


@inlined_kernel
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
def take_active_set_steps(problem: ContactProblem, W: FloatArray, scratch: SolverScratch) -> int:
    """Take Newton steps, each up to where a contact opens or slips, until a full step is feasible; return their cost.

    This is the primal active-set method (Nocedal and Wright, "Numerical Optimization", 16.5): steps remove contacts
    from the active set, and sweeps add those that are missing. A single step between sweeps would not do, because the
    sweeps close again what it has opened. With friction the solution is no minimum, and the potential need not fall.
    The cost is in sweeps, and grows with the cube of the number of unknowns.
    """
    unknowns, cost, k, fraction = scratch.unknowns, 0, problem.rows.n_contacts, 0.0
    while fraction < 1.0 and cost < MAX_ACTIVE_SET_COST:
        n = list_unknowns(problem, unknowns)
        if n == 0 or not newton_step(problem, W, unknowns, n):
            return cost
        cost += 1 + n**3 // (27 * k * k)
        fraction = feasible_step_length(problem, unknowns, n, scratch.force_change)
        add_step(problem, unknowns, n, min(fraction * (1.0 + OVERSHOOT), 1.0))
        update_motion(problem, W, scratch.free)
    return cost


@kernel
def copy_forces(source: FloatArray, target: FloatArray, count: int) -> None:
    """Copy the first ``count`` forces."""
    for block in range(count):
        for axis in range(3):
            target[block, axis] = source[block, axis]


@kernel
def update_motion(problem: ContactProblem, W: FloatArray, free: FloatArray) -> None:
    """Write the motion u = W f + u_free (3 k,), in m; ``free`` is u_free."""
    motion = problem.motion
    for row in range(W.shape[0]):
        motion[row] = free[row]
    for block in range(problem.rows.n_contacts):
        for axis in range(3):
            force = problem.rows.force_n[block, axis]
            if force != 0.0:
                for column in range(W.shape[0]):
                    motion[column] += W[3 * block + axis, column] * force
