"""What a solve of the contact problem is made of: sweeps, and Newton steps from contact to contact."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Struct
from services.mechanics.contact.admissible import closed_axes, relax, slides
from services.mechanics.contact.newton import add_step, list_unknowns, newton_step, room_for_step
from services.mechanics.contact.problem import ContactProblem, Unknowns

# Newton steps that follow each other may cost as much as so many sweeps.
MOST_ON_THE_WAY = 30
# Beyond where one opens or slips by so much of the step: it has to be seen to have done so.
BEYOND = 1e-9


class SolverScratch(Struct):
    """Work space of a solve with at most m rows."""

    unknowns: Unknowns
    force: Annotated[FloatArray, "c", 3]
    way: Annotated[FloatArray, "c", 3]  # what a Newton step would change of them
    free: Annotated[FloatArray, "m"]
    friction: Annotated[FloatArray, "c"]  # coefficients, while friction has bounds

    @classmethod
    def allocate(cls, capacity: int) -> SolverScratch:
        """Return work space for ``capacity`` contacts."""
        m = 3 * capacity
        unknowns = Unknowns.zeros(m=m, matrix=np.zeros(m * m))
        return cls.zeros(c=capacity, m=m, unknowns=unknowns)


@kernel
def sweep(problem: ContactProblem, W: FloatArray) -> tuple[float, float]:
    """Relax every contact once; return the largest change of a force component, and of a place along its normal."""
    largest_n, largest_m, rows, change = 0.0, 0.0, problem.rows, problem.change
    for block in range(rows.n_contacts):
        relax(problem, W, block)
        largest_n = max(largest_n, abs(change[0]), abs(change[1]), abs(change[2]))
        largest_m = max(largest_m, abs(change[0]) * W[3 * block, 3 * block])
    return largest_n, largest_m


@kernel
def is_balanced(problem: ContactProblem, tolerance_n: float) -> bool:
    """Return whether no force of what is closed is further than ``tolerance_n`` from the solution.

    A residual motion r of closed rows is made by a force of at most |r| / c, with c the softness of the surfaces: W is
    nowhere softer than that. Two jaws that press on one place share its force in any way, and only c tells how; a sweep
    changes such shares by a thousandth of what is missing.
    """
    rows, motion = problem.rows, problem.motion
    for block in range(rows.n_contacts):
        for axis in range(closed_axes(rows, block, slides(rows, block))):
            if abs(motion[3 * block + axis]) > rows.softness_m_n[block, axis] * tolerance_n:
                return False
    return True


@kernel
def go_down(problem: ContactProblem, W: FloatArray, scratch: SolverScratch) -> int:
    """Take Newton steps, each up to where a contact opens or slips, until one goes all the way; return what they cost.

    So a method of active sets minimises over what is closed, and sweeps close what is missing (Nocedal and Wright,
    "Numerical Optimization", 16.5). One step between sweeps does not: they close again what it has opened. Friction
    makes it no minimum, and the potential need not fall. The cost is in sweeps: a dense solve of many is dear.
    """
    unknowns, cost, k, share = scratch.unknowns, 0, problem.rows.n_contacts, 0.0
    while share < 1.0 and cost < MOST_ON_THE_WAY:
        n = list_unknowns(problem, unknowns)
        if n == 0 or not newton_step(problem, W, unknowns, n):
            return cost
        cost += 1 + n**3 // (27 * k * k)
        share = room_for_step(problem, unknowns, n, scratch.way)
        add_step(problem, unknowns, n, min(share * (1.0 + BEYOND), 1.0))
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
    """Write the motion u = W f + u_free."""
    motion = problem.motion
    for row in range(W.shape[0]):
        motion[row] = free[row]
    for block in range(problem.rows.n_contacts):
        for axis in range(3):
            force = problem.rows.force_n[block, axis]
            if force != 0.0:
                for column in range(W.shape[0]):
                    motion[column] += W[3 * block + axis, column] * force
