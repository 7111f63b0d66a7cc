"""Warm start of a solve: rows begin with the forces of the last tick, matched by bodies and by place on the wall.

If the change of all forces in the last tick was as expected, rows begin with the forces expected now: a steady motion
changes them by nearly as much again.

The elastic slip of friction is carried over with the force, also to the next triangle, and is reset when the surfaces
separate. A triangle alone does not identify a contact, because a contact on an edge alternates between two.
"""

from __future__ import annotations

import math
from typing import Annotated

from trocar.services.mechanics.arrays import BoolArray, FloatArray, LongArray
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Struct
from trocar.services.mechanics.compiled.vectors import along, dot, put_row, row_of, squared_distance, subtract
from trocar.services.mechanics.compiled.vectors import row as vector
from trocar.services.mechanics.contact.admissible import tangential_limit
from trocar.services.mechanics.contact.free_motion import sunk_at_end
from trocar.services.mechanics.contact.identity import without_target
from trocar.services.mechanics.contact.laws import HAS_FRICTION
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.rows import N_BODIES, ContactRows, in_frame
from trocar.services.mechanics.contact.working_set import place_at_rest


class ForceMemory(Struct):
    """Forces (N), elastic slips (m) along world axes and ways of sliding of the last tick; scratch for the search."""

    identity: Annotated[LongArray, "c"]
    force_n: Annotated[FloatArray, "c", 3]
    change_n: Annotated[FloatArray, "c", 3]  # from the tick before
    elastic_m: Annotated[FloatArray, "c", 3]
    place_m: Annotated[FloatArray, "c", 3]  # on the undeformed wall; zero for contacts without the wall
    slid_m: Annotated[FloatArray, "c"]  # see `sliding`
    sunk_m: Annotated[FloatArray, "c"]  # see `free_motion`
    are_sliding: Annotated[BoolArray, 2 * N_BODIES]  # whether two bodies slide on each other
    pressed_n: Annotated[FloatArray, 2 * N_BODIES]  # scratch: normal forces between them
    sliding_n: Annotated[FloatArray, 2 * N_BODIES]
    taken: Annotated[BoolArray, "c"]
    found: Annotated[BoolArray, "c"]
    last_n: Annotated[FloatArray, "c", 3]  # of the rows that were found
    expected_n: Annotated[FloatArray, "c", 3]  # if they go on changing as in the last tick
    is_smooth: bool = False  # whether that was right in the last tick
    dt_s: float = 0.0  # length of the last step
    least_change_n: float = math.inf  # changes that are all smaller are not foretold: solves would keep them going
    n_contacts: int = 0


#: A sticking contact moves on the wall by less than this in a step.
SAME_PLACE_M = 50e-6
#: A solve that ends by itself leaves residuals of some 10 nm, which the next one takes back. Ten times that is kept.
ENDED_M = 0.1e-6
#: Rows begin with expected forces if the squares of the last errors were below this fraction of those of the changes.
SMOOTH = 0.25


@inlined_kernel
def recall_forces(memory: ForceMemory, rows: ContactRows, vertices_m: FloatArray) -> None:
    """Fill ``force_n``, ``elastic_m``, ``friction_energy_j`` and ``slid_m`` of new rows from the memory.

    Each stored force is used once; rows without one keep zeros. A first pass matches rows with the same first body at
    the same place on the wall, whose undeformed nodes are ``vertices_m`` (n, 3), or, without the wall, with the same
    pair of bodies. A second pass gives the other rows the nearest force of the same body against the same kind of
    target, so that a contact that has slid keeps its force.
    """
    memory.taken[: memory.n_contacts] = False
    for row in range(rows.n_contacts):
        memory.found[row] = _recall(memory, rows, row, _nearest(memory, rows, row, vertices_m, False))
        if memory.found[row] and memory.is_smooth and rows.dt_s == memory.dt_s:
            put_row(rows.force_n, row, in_frame(rows, row, vector(memory.expected_n, row)))
    for row in range(rows.n_contacts):
        if not memory.found[row]:
            _recall(memory, rows, row, _nearest(memory, rows, row, vertices_m, True))


@kernel
def _nearest(memory: ForceMemory, rows: ContactRows, row: int, vertices_m: FloatArray, any_place: bool) -> int:
    """Return the nearest unused entry with the row's bodies, or -1; only one at the same place unless ``any_place``."""
    identity, nearest = rows.identity[row], -1
    at = place_at_rest(vertices_m, rows.duct_node, row, vector(rows.duct_weight, row))
    is_on_wall, least_2 = at != (0.0, 0.0, 0.0), math.inf if any_place else SAME_PLACE_M**2
    for old in range(memory.n_contacts):
        other = memory.identity[old]
        if memory.taken[old] or without_target(other) != without_target(identity):
            continue
        if not (any_place or is_on_wall or other == identity):
            continue
        distance_2 = squared_distance(at, vector(memory.place_m, old))
        if distance_2 < least_2:
            nearest, least_2 = old, distance_2
    return nearest


@kernel
def _recall(memory: ForceMemory, rows: ContactRows, row: int, old: int) -> bool:
    """Copy entry ``old`` of the memory to a row; return whether there is one."""
    if old < 0:
        return False
    memory.taken[old] = True
    rows.slid_m[row], rows.sunk_m[row] = memory.slid_m[old], memory.sunk_m[old]
    put_row(rows.elastic_m, row, vector(memory.elastic_m, old))
    last = vector(memory.force_n, old)
    put_row(memory.last_n, row, last)
    put_row(memory.expected_n, row, along(last, vector(memory.change_n, old), 1.0))
    put_row(rows.force_n, row, in_frame(rows, row, last))
    for axis in range(1, 3 if HAS_FRICTION[rows.law[row]] else 1):
        rows.friction_energy_j[row] += 0.5 * rows.softness_m_n[row, axis] * rows.force_n[row, axis] ** 2
    return True


@inlined_kernel
def store_forces(memory: ForceMemory, rows: ContactRows, forces: FloatArray, vertices_m: FloatArray) -> None:
    """Store the solved ``forces`` (C, 3) along world axes, and their places on the undeformed wall."""
    memory.n_contacts, memory.dt_s = rows.n_contacts, rows.dt_s
    change_2, error_2, largest_2 = 0.0, 0.0, 0.0
    for row in range(rows.n_contacts):
        force = vector(forces, row)
        memory.change_n[row] = 0.0
        if memory.found[row]:
            change = subtract(force, vector(memory.last_n, row))
            put_row(memory.change_n, row, change)
            row_2 = dot(change, change)
            change_2, largest_2 = change_2 + row_2, max(largest_2, row_2)
            error_2 += squared_distance(force, vector(memory.expected_n, row))
        at_rest = place_at_rest(vertices_m, rows.duct_node, row, vector(rows.duct_weight, row))
        put_row(memory.place_m, row, at_rest)
        put_row(memory.force_n, row, force)
        memory.sunk_m[row] = sunk_at_end(rows, row)
        memory.identity[row] = rows.identity[row]
    memory.is_smooth = error_2 < SMOOTH * change_2 and largest_2 > memory.least_change_n**2


@inlined_kernel
def store_anchors(problem: ContactProblem, slides: BoolArray, out: FloatArray) -> None:
    r"""Write the elastic slip (C, 3) at the end of the step along world axes, from the solved forces and motions.

    Two sticking surfaces are tied by their own stiffness to the point where they last slid, their *anchor*:
    :math:`f_t = -e / c`, with e the motion since then and c the row's softness. The force depends on e and not on its
    rate, so sticking contacts do not creep, and the force depends on the step no more than e does. Where the cone
    limits the force, the anchor follows: :math:`e = -c f_t`. This is elastoplastic friction (the return mapping of a
    plastic bar in Simo and Hughes, "Computational Inelasticity", 1998, ch. 1). The residual of a solve that was cut
    short is part of e, so that the next solve removes it, but only as far as the cone bears the stretch of an anchor.
    Beyond, the surfaces have slid: an anchor that lay further away would pull them back with work that nobody did.

    ``slides`` (C,) tells where the force is on its cone.
    """
    rows = problem.rows
    for row in range(rows.n_contacts):
        out[row] = 0.0
        force, softness = rows.force_n[row], rows.softness_m_n[row]
        if not HAS_FRICTION[rows.law[row]] or (force[0] == 0.0 and force[1] == 0.0 and force[2] == 0.0):
            continue
        slip_1, slip_2 = -softness[1] * force[1], -softness[2] * force[2]
        if not slides[row]:
            slip_1 += problem.motion[3 * row + 1]
            slip_2 += problem.motion[3 * row + 2]
            borne_n = max(tangential_limit(rows, row), math.hypot(force[1], force[2]))
            most_m, stretch_m = max(softness[1], softness[2]) * borne_n + ENDED_M, math.hypot(slip_1, slip_2)
            if stretch_m > most_m:
                slip_1 *= most_m / stretch_m
                slip_2 *= most_m / stretch_m
        put_row(out, row, along(vector(out, row), row_of(rows.frame, row, 1), slip_1))
        put_row(out, row, along(vector(out, row), row_of(rows.frame, row, 2), slip_2))
