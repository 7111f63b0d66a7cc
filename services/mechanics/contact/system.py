"""All contacts of a step: their rows are collected, assembled and solved, and their forces applied to the bodies."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trocar.services.mechanics.arrays import AnyArray, FloatArray
from trocar.services.mechanics.collision.pairs import NO_TOOL, ContactPairs
from trocar.services.mechanics.compiled.memory import SavedRows
from trocar.services.mechanics.contact import stages
from trocar.services.mechanics.contact.geometry import Bodies, ContactGeometry
from trocar.services.mechanics.contact.implicit import ImplicitStrategy
from trocar.services.mechanics.contact.pair_rows import append_pairs
from trocar.services.mechanics.contact.passivity import START_UP_S, within_credit
from trocar.services.mechanics.contact.penalty import PenaltyStrategy
from trocar.services.mechanics.contact.problem import UNBOUNDED
from trocar.services.mechanics.contact.state import ContactState, begin_rows
from trocar.services.mechanics.contact.tool_loads import load_tools
from trocar.services.mechanics.scene import ContactSettings

#: Methods that find the contact forces, by their names in `ContactSettings.model`.
STRATEGIES = {"implicit": ImplicitStrategy, "penalty": PenaltyStrategy}


class DroppedContacts(NamedTuple):
    """Contacts that exceeded a capacity, as counts since the start; in each step a contact counts again.

    Attributes:
        pairs: int. Candidates beyond the capacity of detection, or of the memory of pressed points.
        rows: int. Contacts of pairs, grasps and effects beyond the capacity of the solve.
        holds: int. Held points beyond the capacity of holds.
    """

    pairs: int
    rows: int
    holds: int


class ContactSystem:
    r"""Contact rows, their Delassus operator W and the solved forces of one step.

    Positions refer to the start of the step; motions, gaps and forces to its end: :math:`u^+ = u_{free} + W f` with
    :math:`W = J A^{-1} J^T`, the sum over duct (modes and residual compliance), catheter (banded inverse), spheres and
    tools (virtual coupling). Every force acts on both bodies of its row.

    Attributes:
        bodies: Bodies. Duct, catheter and tools.
        settings: ContactSettings. Those of the scene.
        geometry: ContactGeometry. Poses and motions from which rows are built.
        strategy: ImplicitStrategy. The method that finds the forces, chosen by the scene.
        rows: ContactRows. The rows of this step.
        force_n: (C, 3) float64. Forces on the first bodies along world axes, in N.
        slides: (C,) bool. Whether a contact slid, or a hold slipped, in the last solve.
        sweeps: int. Sweeps of the last solve.
        dropped_pairs: int. Candidate pairs since the start that exceeded the capacity of detection.
    """

    def __init__(self, bodies: Bodies, settings: ContactSettings) -> None:
        self.bodies = bodies
        self.settings = settings
        self.geometry = ContactGeometry.of(bodies)
        self._state = ContactState.allocate(settings.capacity, self.geometry)
        self.address = self._state.address
        self.strategy = STRATEGIES[settings.model](bodies, settings, self._state)
        self.rows = self._state.rows
        self.force_n = self._state.force_n
        self.slides = self._state.slides
        self.sweeps = 0
        self.dropped_pairs = 0
        self._first_new = 0
        self._applied_forces = self._saved = False
        self._kept_rows = SavedRows([*self.rows.own_memory()[1:], self.force_n, self.slides])
        self._vanished_load, self._vanished_load_is_stored = np.zeros(bodies.duct.state.q.size), False

    @property
    def motion_m(self) -> FloatArray:
        """(3 k,) gaps and slips in m at the end of the step, with the solved forces, in the contacts' frames."""
        return self._state.problem.motion[: 3 * self.rows.n_contacts]

    @property
    def compliance_m_n(self) -> FloatArray:
        """(3 k, 3 k) W in m/N: along world axes while it is assembled, then in the contacts' frames."""
        return self._state.W

    @property
    def is_cut(self) -> bool:
        """Whether the last solve has ended for want of work, so that rows may end deeper than their laws allow."""
        return bool(self._state.problem.is_cut)

    @property
    def owes_nothing(self) -> bool:
        """Whether contacts have given the bodies no more energy in this step than they may, see `passivity`."""
        return within_credit(self._state.ledger)

    def clear(self) -> None:
        """Remove the rows of the last step; the memory for the warm start keeps their forces."""
        begin_rows(self.address, self.bodies.duct.dt_s)
        self._first_new = 0

    def step_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays that a step changes and the next step needs."""
        return *self._state.memory.own_memory(), *self._state.ledger.own_memory()

    def save_start(self) -> None:
        """Save the state at the start of a step that is not in `step_arrays`."""
        self._saved = self._applied_forces

    def restore_start(self) -> None:
        """Restore the saved state. The last step's rows are lost; `remove_vanished_tools` has stored their load."""
        self._applied_forces = self._saved
        self._vanished_load_is_stored = True

    def keep_rows(self) -> None:
        """Keep the rows of this step with their forces, until others are."""
        self._kept_rows.save(self.rows.n_contacts)

    def bring_rows_back(self) -> None:
        """Replace the rows by those that were kept last: nobody has borne the forces of those since."""
        self.rows.n_contacts = self._kept_rows.count
        self._kept_rows.restore()

    def remove_vanished_tools(self) -> None:
        """Remove from the duct the forces of the last step that were exerted by tools that have vanished."""
        duct, tools = self.bodies.duct, self.bodies.tools
        if self._applied_forces and tools.have_vanished:
            if not self._vanished_load_is_stored:
                k = self.rows.n_contacts
                by = self.rows.tool[:k]
                is_gone = (by != NO_TOOL) & ~tools.present[by]
                self._vanished_load = duct.modal_load(np.where(is_gone[:, None], self.force_n[:k], 0.0))
            duct.remove_half_impulse(self._vanished_load)
        self._vanished_load_is_stored = False

    def append(self, pairs: ContactPairs) -> None:
        """Append rows for candidate pairs."""
        self.dropped_pairs += append_pairs(pairs.address, self.geometry.address, self.rows.address)

    def append_as_many(self, pairs: ContactPairs) -> None:
        """Append rows for candidate pairs, as many as there is room for."""
        pairs.count = min(pairs.count, max(self.rows.capacity - self.rows.reserved - self.rows.n_contacts, 0))
        self.append(pairs)

    def complete_rows(self) -> None:
        """Complete gaps and slips with the duct's displacement, and begin with the forces of the last tick."""
        duct = self.bodies.duct
        if duct.kept_address is None:
            duct.gather(*self.rows.on_duct)
        elif stages.gather_and_complete(self.address, duct.loads_address, duct.kept_address):
            return
        else:
            duct.displace(*self.rows.on_duct)
        stages.complete_rows(self.address, duct.displacement_m, duct.motion_m)

    def assemble(self) -> int:
        """Write W: of all rows, or of those that were appended last; return how many blocks were written."""
        first, k = self._first_new, self.rows.n_contacts
        self.strategy.assemble(first)
        return k * k - first * first

    def append_new_pairs(self, pairs: ContactPairs) -> None:
        """Append rows for pairs to a solved step; its other rows keep their forces."""
        duct, self._first_new = self.bodies.duct, self.rows.n_contacts
        self.append(pairs)
        duct.gather(*self.rows.on_duct)
        stages.complete_new_rows(self.address, duct.displacement_m, duct.motion_m, self._first_new)

    def old_friction(self) -> FloatArray:
        """Return the friction coefficients of the rows before those that were appended last; a live view."""
        return self.rows.friction[: self._first_new]

    def add_duct_motion(self, motion_m: FloatArray) -> None:
        """Add ``motion_m`` (k, 3) to the free motion of the duct's points, in the rows that were completed last."""
        self.rows.slip_m[self._first_new : len(motion_m)] -= motion_m[self._first_new :]

    def solve(self, iterations: int, dt_s: float, products: float = UNBOUNDED) -> float:
        """Find the contact forces in at most about ``iterations`` sweeps, see `ImplicitStrategy.solve`.

        It takes about ``products`` block products (3 x 3) at most. Return how many it has taken.
        """
        problem = self._state.problem
        problem.products_left = products
        self.sweeps = self.strategy.solve(iterations, dt_s)
        return products - problem.products_left

    def clear_forces(self) -> None:
        """Clear the memory of forces, because nothing touches."""
        self.sweeps, self._state.problem.is_cut = 0, False
        self._state.memory.n_contacts = 0
        self._state.memory.are_sliding[:] = False
        self._state.ledger.contact_time_s = START_UP_S

    def forget(self) -> None:
        """Remove the contacts of this step, and clear the memory of forces."""
        self.clear()
        self.clear_forces()
        self.keep_rows()
        self._vanished_load_is_stored = False

    def apply(self, tool_force: FloatArray) -> None:
        """Apply the forces to all bodies; ``tool_force`` (2, 4) receives the tools' generalised forces."""
        bodies, rows = self.bodies, self.rows
        k = rows.n_contacts
        catheter, rod = bodies.catheter, bodies.catheter.plain_integrator
        if k and rod is not None:
            motion, step = (
                (catheter.state.position_m, catheter.state.velocity_m_s),
                (rod.velocity_gain_s, rod.is_factored),
            )
            addresses = (self.address, bodies.duct.loads_address, catheter.step_address, bodies.tools.address)
            more = (bodies.duct.dt_s, tool_force, rod.twist is None)
            rod.note_factors(stages.apply_to_bodies(addresses, rod.addresses, motion, step, *more))
            bodies.duct.turn_loads()
            if rod.twist is not None:
                rod.remove_energy_gain(catheter.state, catheter.step_address)
            catheter.note_contacts(k)
        else:
            if k or self._applied_forces:  # once more without forces, to remove those of the last step
                forces = self.force_n[:k]
                bodies.duct.correct(*rows.on_duct, forces)
                catheter.correct(*rows.on_rod, forces)
            load_tools(self.address, tool_force)
            bodies.tools.correct(tool_force)
        self._applied_forces = k > 0
