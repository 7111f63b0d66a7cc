"""The state of the contact solve: all its arrays, as one struct."""

from __future__ import annotations

from typing import Annotated

from services.mechanics.arrays import BoolArray, FloatArray, IntArray
from services.mechanics.compiled.struct import Struct, reader
from services.mechanics.contact.geometry import ContactGeometry
from services.mechanics.contact.passivity import Ledger
from services.mechanics.contact.problem import ContactProblem
from services.mechanics.contact.rows import N_ROD_POINTS, ContactRows
from services.mechanics.contact.solver_steps import SolverScratch
from services.mechanics.contact.warm_start import ForceMemory


class ContactState(Struct):
    """Contacts of one step, the geometry from which they are built, and their solution; for c contacts, m = 3 c.

    Attributes:
        geometry: ContactGeometry. Poses and motions of the bodies.
        rows: ContactRows. The contacts.
        problem: ContactProblem. The problem of these rows; its motion holds gaps and slips at the end of the step.
        memory: ForceMemory. Forces of the last step, for the warm start.
        ledger: Ledger. Energy that contacts have added, see `passivity`.
        scratch: SolverScratch. Work space of the solve.
        delassus: (m m,) float64. Delassus operator W, packed as (3 k, 3 k) for k contacts.
        force_n: (c, 3) float64. Forces on the first bodies along world axes.
        slides: (c,) bool. Whether a force is at the limit of its law.
        rod_points: (4 c, 2) int32. Scratch for the catheter's compliance.
    """

    geometry: ContactGeometry
    rows: ContactRows
    problem: ContactProblem
    memory: ForceMemory
    ledger: Ledger
    scratch: SolverScratch
    delassus: Annotated[FloatArray, "m * m"]
    force_n: Annotated[FloatArray, "c", 3]
    slides: Annotated[BoolArray, "c"]
    rod_points: Annotated[IntArray, "points", 2]

    @classmethod
    def allocate(cls, capacity: int, geometry: ContactGeometry) -> ContactState:
        """Return room for ``capacity`` contacts and holds."""
        m = 3 * capacity
        rows = ContactRows.zeros(c=capacity)
        extents = {"c": capacity, "m * m": m * m, "points": N_ROD_POINTS * capacity}
        return cls.zeros(
            geometry=geometry,
            rows=rows,
            problem=ContactProblem.zeros(m=m, rows=rows),
            memory=ForceMemory.zeros(c=capacity),
            ledger=Ledger.zeros(),
            scratch=SolverScratch.allocate(capacity),
            **extents,
        )

    @property
    def W(self) -> FloatArray:
        """(3 k, 3 k) Delassus operator."""
        size = 3 * self.rows.n_contacts
        view: FloatArray = self.delassus[: size * size].reshape(size, size)
        return view


state_at = reader(ContactState)
