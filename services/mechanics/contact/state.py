"""The state of the contact solve: all its arrays, as one struct."""

from __future__ import annotations

from typing import Annotated

from trocar.services.mechanics.arrays import BoolArray, FloatArray, IntArray
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.contact.geometry import ContactGeometry
from trocar.services.mechanics.contact.passivity import Ledger
from trocar.services.mechanics.contact.problem import ContactProblem
from trocar.services.mechanics.contact.rows import N_ROD_POINTS, ContactRows
from trocar.services.mechanics.contact.warm_start import ForceMemory


class ContactState(Struct):
    """Contacts of one step, the geometry from which they are built, and their solution; for c contacts, m = 3 c."""

    geometry: ContactGeometry
    rows: ContactRows
    problem: ContactProblem  # of these rows
    memory: ForceMemory
    ledger: Ledger
    delassus: Annotated[FloatArray, "m * m"]  # the operator W, packed as (3 k, 3 k) for k contacts
    force_n: Annotated[FloatArray, "c", 3]  # on the first bodies, along world axes
    slides: Annotated[BoolArray, "c"]  # whether a force is at the limit of its law
    rod_points: Annotated[IntArray, "points", 2]  # scratch for the catheter's compliance

    @classmethod
    def allocate(cls, capacity: int, geometry: ContactGeometry) -> ContactState:
        """Return room for ``capacity`` contacts and holds."""
        m = 3 * capacity
        rows = ContactRows.zeros(c=capacity)
        extents = {"c": capacity, "m * m": m * m, "points": N_ROD_POINTS * capacity}
        return cls.zeros(
            geometry=geometry,
            rows=rows,
            problem=ContactProblem.of(rows),
            memory=ForceMemory.zeros(c=capacity),
            ledger=Ledger.zeros(),
            **extents,
        )

    @property
    def W(self) -> FloatArray:
        """(3 k, 3 k) Delassus operator."""
        size = 3 * self.rows.n_contacts
        view: FloatArray = self.delassus[: size * size].reshape(size, size)
        return view


state_at = reader(ContactState)


@kernel
def begin_rows(address: Address[ContactState], dt_s: float) -> None:
    """Remove all rows, and count the solves of a step of this length."""
    state = state_at(address)
    state.rows.n_contacts, state.rows.dt_s, state.ledger.n_solves = 0, dt_s, 0
    state.problem.cycles = False
