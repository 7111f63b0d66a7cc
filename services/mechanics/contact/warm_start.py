"""Warm start of a solve: rows take last tick's forces, matched by the bodies and their place on the wall.

The elastic slip of friction moves with them, to the next triangle as well; it is forgotten when the surfaces part. A
triangle alone does not identify a contact: on an edge it alternates between two.
"""

from __future__ import annotations

import math
from typing import Annotated

from services.mechanics.arrays import BoolArray, FloatArray, LongArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Struct
from services.mechanics.compiled.vectors import Vector, put_row, squared_distance
from services.mechanics.compiled.vectors import row as vector
from services.mechanics.contact.identity import without_target
from services.mechanics.contact.laws import ELASTIC_AXES
from services.mechanics.contact.problem import ContactProblem
from services.mechanics.contact.rows import ContactRows
from services.mechanics.contact.working_set import place_at_rest


class ForceMemory(Struct):
    """Forces and elastic slips along world axes and sliding states of the last tick, and scratch for the search."""

    identity: Annotated[LongArray, "c"]
    force_n: Annotated[FloatArray, "c", 3]
    elastic_m: Annotated[FloatArray, "c", 3]
    place_m: Annotated[FloatArray, "c", 3]  # on the undeformed wall, zero for what is not on it
    slides: Annotated[BoolArray, "c"]
    taken: Annotated[BoolArray, "c"]
    found: Annotated[BoolArray, "c"]
    n_contacts: int = 0


#: A contact that sticks moves on the wall by less in a step.
SAME_PLACE_M = 50e-6


@kernel
def recall_forces(memory: ForceMemory, rows: ContactRows, slides: BoolArray, vertices_m: FloatArray) -> None:
    """Fill ``rows.force_n``, ``elastic_m``, ``held_j`` and ``slides`` (C,) from the memory, or with zero.

    A row first takes the force of the same first body at the same place on the wall, whose undeformed nodes are
    ``vertices_m`` (n, 3), or, beside the wall, of the same pair; then the nearest of the same body against the same
    kind of target, so that a contact which slid on keeps its force. Each remembered force is used once.
    """
    memory.taken[: memory.n_contacts] = False
    for row in range(rows.n_contacts):
        rows.force_n[row] = 0.0
        rows.elastic_m[row] = 0.0
        rows.held_j[row] = 0.0
        slides[row] = False
        memory.found[row] = _recall(memory, rows, row, _nearest(memory, rows, row, vertices_m, False), slides)
    for row in range(rows.n_contacts):
        if not memory.found[row]:
            _recall(memory, rows, row, _nearest(memory, rows, row, vertices_m, True), slides)


@kernel
def _nearest(memory: ForceMemory, rows: ContactRows, row: int, vertices_m: FloatArray, anywhere: bool) -> int:
    """Return the nearest unused force of the row's bodies, only at its old place unless ``anywhere``; or -1."""
    identity, at, nearest = rows.identity[row], _place_m(rows, row, vertices_m), -1
    is_on_wall, least = at != (0.0, 0.0, 0.0), math.inf if anywhere else SAME_PLACE_M**2
    for old in range(memory.n_contacts):
        other = memory.identity[old]
        if memory.taken[old] or without_target(other) != without_target(identity):
            continue
        if not (anywhere or is_on_wall or other == identity):
            continue
        away = squared_distance(at, vector(memory.place_m, old))
        if away < least:
            nearest, least = old, away
    return nearest


@kernel
def _place_m(rows: ContactRows, row: int, vertices_m: FloatArray) -> Vector:
    """Return where a row is on the undeformed wall; zero for what is not on it."""
    return place_at_rest(vertices_m, rows.duct_node, row, vector(rows.duct_weight, row))


@kernel
def _recall(memory: ForceMemory, rows: ContactRows, row: int, old: int, slides: BoolArray) -> bool:
    """Copy entry ``old`` of the memory to a row; return whether there is one."""
    if old < 0:
        return False
    memory.taken[old] = True
    slides[row] = memory.slides[old]
    for axis in range(3):
        rows.elastic_m[row, axis] = memory.elastic_m[old, axis]
        rows.force_n[row, axis] = (
            rows.frame[row, axis, 0] * memory.force_n[old, 0]
            + rows.frame[row, axis, 1] * memory.force_n[old, 1]
            + rows.frame[row, axis, 2] * memory.force_n[old, 2]
        )
        if axis >= 3 - ELASTIC_AXES[rows.law[row]]:
            rows.held_j[row] += 0.5 * rows.softness_m_n[row, axis] * rows.force_n[row, axis] ** 2
    return True


@kernel
def store_forces(
    memory: ForceMemory, rows: ContactRows, forces: FloatArray, slides: BoolArray, vertices_m: FloatArray
) -> None:
    """Store the solved forces (C, 3) along world axes, their places on the undeformed wall, and sliding flags."""
    memory.n_contacts = rows.n_contacts
    for row in range(rows.n_contacts):
        put_row(memory.place_m, row, _place_m(rows, row, vertices_m))
        memory.identity[row] = rows.identity[row]
        memory.slides[row] = slides[row]
        for axis in range(3):
            memory.force_n[row, axis] = forces[row, axis]


@kernel
def store_anchors(problem: ContactProblem, slides: BoolArray, out: FloatArray) -> None:
    r"""Write the elastic slip (C, 3) at the end of the step along world axes, from the solved forces and motions.

    Two surfaces that stick are tied at the point where they last slid, their *anchor*, by the stiffness of the surfaces
    themselves: :math:`f_t = -e / c`, e being how far they have moved since and c the row's softness. As e, and not its
    rate, sets the force, what sticks does not creep, and the force depends on the step as little as e does. Where the
    cone bounds the force the anchor follows: :math:`e = -c f_t` (elastoplastic friction; the return mapping of a
    plastic bar in Simo and Hughes, "Computational Inelasticity", 1998, ch. 1). What a solve that was cut short leaves
    open is part of e: the next one takes it up.

    ``slides`` (C,) says where the force is on its cone.
    """
    rows = problem.rows
    for row in range(rows.n_contacts):
        out[row] = 0.0
        force = rows.force_n[row]
        if force[0] == 0.0 and force[1] == 0.0 and force[2] == 0.0:
            continue
        for axis in range(3 - ELASTIC_AXES[rows.law[row]], 3):
            slip = -rows.softness_m_n[row, axis] * force[axis]
            if not slides[row]:
                slip += problem.motion[3 * row + axis]
            for k in range(3):
                out[row, k] += slip * rows.frame[row, axis, k]
