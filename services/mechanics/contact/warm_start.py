"""Last tick's contact forces as the start of this tick's solve, found again by the pair's identity."""

from __future__ import annotations

from typing import Annotated

from services.mechanics.arrays import BoolArray, FloatArray, LongArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Struct
from services.mechanics.contact.identity import without_target
from services.mechanics.contact.laws import ELASTIC_AXES
from services.mechanics.contact.rows import ContactRows


class ForceMemory(Struct):
    """Forces and elastic slips along world axes and sliding states of the last tick, and scratch for the search."""

    identity: Annotated[LongArray, "c"]
    force_n: Annotated[FloatArray, "c", 3]
    elastic_m: Annotated[FloatArray, "c", 3]
    slides: Annotated[BoolArray, "c"]
    taken: Annotated[BoolArray, "c"]
    found: Annotated[BoolArray, "c"]
    n_contacts: int = 0


@kernel
def recall_forces(memory: ForceMemory, rows: ContactRows, slides: BoolArray) -> None:
    """Fill ``rows.force_n``, ``elastic_m``, ``held_j`` and ``slides`` (C,) with what is remembered, or with zero.

    First the same pair, then the same first body against the same kind of target, so that a contact which slid
    on to the next triangle keeps its force. A remembered force is given away once.
    """
    memory.taken[: memory.n_contacts] = False
    for row in range(rows.n_contacts):
        rows.force_n[row] = 0.0
        rows.elastic_m[row] = 0.0
        rows.held_j[row] = 0.0
        slides[row] = False
        memory.found[row] = _match(memory, rows, row, False, slides)
    for row in range(rows.n_contacts):
        if not memory.found[row]:
            _match(memory, rows, row, True, slides)


@kernel
def _match(memory: ForceMemory, rows: ContactRows, row: int, on_any_target: bool, slides: BoolArray) -> bool:
    """Give the row the first force of its identity that is left, ``on_any_target`` of the same kind if wanted."""
    identity = rows.identity[row]
    for old in range(memory.n_contacts):
        other = memory.identity[old]
        is_same = without_target(other) == without_target(identity) if on_any_target else other == identity
        if is_same and not memory.taken[old]:
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
    return False


@kernel
def store_forces(memory: ForceMemory, rows: ContactRows, forces: FloatArray, slides: BoolArray) -> None:
    """Remember the solved forces (C, 3) along world axes and who slides."""
    memory.n_contacts = rows.n_contacts
    for row in range(rows.n_contacts):
        memory.identity[row] = rows.identity[row]
        memory.slides[row] = slides[row]
        for axis in range(3):
            memory.force_n[row, axis] = forces[row, axis]
