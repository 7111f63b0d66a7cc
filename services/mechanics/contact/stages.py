"""Stages before and after a contact solve. Each is one kernel, which reads the contact state from its address."""

from __future__ import annotations

from services.mechanics.arrays import BoolArray, FloatArray
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.compiled.vectors import put_row
from services.mechanics.compiled.vectors import row as vector
from services.mechanics.contact import admissible
from services.mechanics.contact.free_motion import subtract_duct_motion
from services.mechanics.contact.rows import ContactRows, in_world
from services.mechanics.contact.state import ContactState, state_at
from services.mechanics.contact.warm_start import recall_forces, store_forces


@kernel
def complete_rows(state_address: Address[ContactState], displacement: FloatArray, motion: FloatArray) -> None:
    """Complete gaps and slips (`subtract_duct_motion`), and recall the forces of the last tick (`recall_forces`).

    ``displacement`` and ``motion`` (k, 3) are those of the duct at the contact points, in m.
    """
    state = state_at(state_address)
    subtract_duct_motion(state.rows, displacement, motion, 0)
    recall_forces(state.memory, state.rows, state.slides, state.geometry.wall.vertices)


@kernel
def complete_new_rows(
    state_address: Address[ContactState], displacement: FloatArray, motion: FloatArray, first: int
) -> None:
    """Complete the rows from ``first`` on as `complete_rows` does, but with zero forces."""
    state = state_at(state_address)
    rows = state.rows
    subtract_duct_motion(rows, displacement, motion, first)
    for row in range(first, rows.n_contacts):
        state.slides[row], rows.friction_energy_j[row] = False, 0.0
        for axis in range(3):
            rows.force_n[row, axis] = rows.elastic_m[row, axis] = 0.0


@kernel
def finish(state: ContactState) -> None:
    """Write sliding flags and forces along world axes, and store both for the next warm start."""
    mark_sliding(state.rows, state.slides)
    write_world_forces(state.rows, state.force_n)
    store_forces(state.memory, state.rows, state.force_n, state.slides, state.geometry.wall.vertices)


@inlined_kernel
def mark_sliding(rows: ContactRows, out: BoolArray) -> None:
    """Write for each contact (k,) whether its force is at the limit of its law."""
    for row in range(rows.n_contacts):
        out[row] = admissible.slides(rows, row)


@inlined_kernel
def write_world_forces(rows: ContactRows, out: FloatArray) -> None:
    """Write the forces on the first bodies along world axes into ``out`` (k, 3), in N."""
    for row in range(rows.n_contacts):
        put_row(out, row, in_world(rows, row, vector(rows.force_n, row)))
