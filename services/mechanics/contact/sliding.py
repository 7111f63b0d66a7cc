"""Which of its two coefficients a contact's friction has: the static one until its surfaces have slid on each other.

Where a body rests on many contacts, they strain each other: some are on their cones while the body sticks. If each of
those had the kinetic coefficient at once, it would load the others until the body slides far below the static one. So
what a contact remembers is how far its surfaces have slid since they last stuck. Up to `SLID_M` that is no more than
a change of how contacts share a load, and the coefficient is the static one. Beyond, they slide.

Sliding belongs to two bodies, not to a row. While most of the pressure between two bodies is on contacts that slide,
none of their contacts sticks: one that comes anew slides as well, and so does one that a bump stops for a moment.
"""

from __future__ import annotations

import math

from trocar.services.mechanics.arrays import BoolArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.contact.laws import HAS_FRICTION
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.rows import ContactRows, pair_of_bodies
from trocar.services.mechanics.contact.warm_start import SAME_PLACE_M, ForceMemory

#: A contact that has slid so far is at another place on the wall.
SLID_M = SAME_PLACE_M
# Contacts that are slower rest, even on their cones: a hundredth of the speed that counts as rest, so that it takes
# five seconds to creep by `SLID_M`.
REST_M_S = 1e-5
#: Share of the pressure between two bodies that has to be on sliding contacts, for the bodies to slide.
MOST = 0.5


@kernel
def begin_slides(memory: ForceMemory, rows: ContactRows, first: int) -> None:
    """Let the rows from ``first`` on that the memory does not know slide if their bodies do."""
    for row in range(first, rows.n_contacts):
        if rows.slid_m[row] < 0.0:
            rows.slid_m[row] = SLID_M if memory.are_sliding[pair_of_bodies(rows, row)] else 0.0


@inlined_kernel
def store_slides(memory: ForceMemory, problem: ContactProblem, on_cone: BoolArray) -> None:
    """Store how far each contact has slid at the end of the step, and which bodies slide on each other.

    ``on_cone`` (C,) tells where friction is at its limit. There the motion along the surface is the slip beyond what
    the surfaces yield elastically.
    """
    rows = problem.rows
    memory.pressed_n[:] = memory.sliding_n[:] = 0.0
    for row in range(rows.n_contacts):
        memory.slid_m[row] = rows.slid_m[row]
        if HAS_FRICTION[rows.law[row]] and rows.friction[row] > 0.0:
            slip_m = _slip_m(problem, on_cone, row)
            memory.slid_m[row] += slip_m
            pressed_n, bodies = max(rows.force_n[row, 0], 0.0), pair_of_bodies(rows, row)
            memory.pressed_n[bodies] += pressed_n
            if slip_m > 0.0 and memory.slid_m[row] >= SLID_M:
                memory.sliding_n[bodies] += pressed_n
    for bodies in range(memory.are_sliding.shape[0]):
        memory.are_sliding[bodies] = memory.sliding_n[bodies] > MOST * memory.pressed_n[bodies]
    for row in range(rows.n_contacts):
        if not memory.are_sliding[pair_of_bodies(rows, row)] and _slip_m(problem, on_cone, row) == 0.0:
            memory.slid_m[row] = 0.0


@kernel
def _slip_m(problem: ContactProblem, on_cone: BoolArray, row: int) -> float:
    """Return by how much the surfaces of a contact slide in the step; zero while they rest."""
    if not on_cone[row] or problem.rows.force_n[row, 0] <= 0.0:
        return 0.0
    slip_m = math.hypot(problem.motion[3 * row + 1], problem.motion[3 * row + 2])
    return slip_m if slip_m > REST_M_S * problem.rows.dt_s else 0.0
