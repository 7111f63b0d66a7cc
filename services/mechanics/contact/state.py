"""Everything that the contact solve works on, as one tuple that kernels find at one address."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from services.mechanics.arrays import BoolArray, FloatArray, IntArray
from services.mechanics.compiled import tuple_reader
from services.mechanics.contact.geometry import ContactGeometry, RodGeometry, ToolGeometry, WallGeometry
from services.mechanics.contact.rows import N_ROD_POINTS, ContactRows
from services.mechanics.contact.solver import SolverScratch
from services.mechanics.contact.warm_start import ForceMemory


class ContactState(NamedTuple):
    """Contacts of one step, what they are built from, and their solution; C is the capacity.

    Attributes
    ----------
    geometry : ContactGeometry
    rows : ContactRows
    memory : ForceMemory
        Of the last step.
    scratch : SolverScratch
    delassus : (9 C^2,) float64
        Delassus operator W, packed as (3 k, 3 k) for k contacts.
    motion : (3 C,) float64
        Gaps and slips at the end of the step.
    force_n : (C, 3) float64
        Forces on the first bodies along world axes.
    slides : (C,) bool
    rod_points : (4 C, 2) int32
        Scratch of the catheter's compliance.
    """

    geometry: ContactGeometry
    rows: ContactRows
    memory: ForceMemory
    scratch: SolverScratch
    delassus: FloatArray
    motion: FloatArray
    force_n: FloatArray
    slides: BoolArray
    rod_points: IntArray

    @classmethod
    def allocate(cls, capacity: int, n_modes: int, geometry: ContactGeometry) -> ContactState:
        """Return room for ``capacity`` contacts and holds on a duct of ``n_modes`` modes."""
        return cls(
            geometry=geometry,
            rows=ContactRows.allocate(capacity),
            memory=ForceMemory.allocate(capacity),
            scratch=SolverScratch.allocate(3 * capacity, n_modes),
            delassus=np.zeros(9 * capacity * capacity),
            motion=np.zeros(3 * capacity),
            force_n=np.zeros((capacity, 3)),
            slides=np.zeros(capacity, np.bool_),
            rod_points=np.zeros((N_ROD_POINTS * capacity, 2), np.int32),
        )

    @property
    def W(self) -> FloatArray:
        """(3 k, 3 k) Delassus operator."""
        size = 3 * self.rows.n_contacts
        view: FloatArray = self.delassus[: size * size].reshape(size, size)
        return view


def _no_geometry() -> ContactGeometry:
    """Return arrays of no content, for their types."""
    tools = ToolGeometry(
        segments=np.zeros((0, 3, 2, 3)),
        radius=np.zeros((0, 3)),
        frame=np.zeros((0, 3, 3)),
        length=np.zeros(0),
        motion=np.zeros((0, 4)),
        held=np.zeros((0, 2), np.bool_),
    )
    rod = RodGeometry(np.zeros((0, 3)), np.zeros((0, 3)), 0.0)
    return ContactGeometry(tools, rod, WallGeometry(np.zeros((0, 3)), np.zeros((0, 3), np.int32), 0.0))


state_at = tuple_reader(ContactState.allocate(1, 0, _no_geometry()))
