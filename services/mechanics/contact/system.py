"""All contacts of one step: collected, assembled in contact space, solved, and given back to the bodies."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from services.mechanics.arrays import AnyArray, FloatArray
from services.mechanics.collision.pairs import NO_TOOL, ContactPairs
from services.mechanics.contact import stages
from services.mechanics.contact.geometry import Bodies, ContactGeometry
from services.mechanics.contact.passivity import BEGINS_S
from services.mechanics.contact.rows import add_rod_motion
from services.mechanics.contact.state import ContactState
from services.mechanics.contact.strategies import STRATEGIES
from services.mechanics.contact.tool_loads import load_tools
from services.mechanics.scene import ContactSettings


class DroppedContacts(NamedTuple):
    """Contacts that found no room since the start, counted anew in every step.

    Attributes:
        pairs: int. Candidates that detection, or the memory of pressed points, had no room for.
        rows: int. Contacts of pairs, grasps and effects that the solve had no room for.
        holds: int. Held points beyond those that are followed.
    """

    pairs: int
    rows: int
    holds: int


class ContactSystem:
    r"""Contact rows, their Delassus operator W and the solved forces of one step.

    Positions are those of the start of the step; motions, gaps and forces refer to its end:
    :math:`u^+ = u_{free} + W f` with :math:`W = J A^{-1} J^T` summed over duct (modes and residual compliance),
    catheter (banded inverse) and tools (virtual coupling). Every force acts on both its bodies.

    Attributes:
        geometry: ContactGeometry. What rows are built from.
        strategy: ContactStrategy. How forces are found, as the scene wants it.
        force_n: (C, 3) float64. Forces on the first bodies along world axes.
        slides: (C,) bool. Whether a contact slid, or a hold slipped, in the last solve.
        sweeps: int. Sweeps that the last solve took.
        dropped_pairs: int. Candidate pairs since the start that detection had no room for.
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
        self._gone, self._gone_is_known = np.zeros(bodies.duct.state.q.size), False

    @property
    def motion_m(self) -> FloatArray:
        """(3 k,) gaps and slips at the end of the step, with the solved forces, in the contacts' frames."""
        return self._state.problem.motion[: 3 * self.rows.n_contacts]

    @property
    def compliance_m_n(self) -> FloatArray:
        """(3 k, 3 k) W in m/N: along world axes while it is assembled, then in the contacts' frames."""
        return self._state.W

    def clear(self) -> None:
        """Forget the rows of the last step; their forces stay remembered."""
        self.rows.put_zero("n_contacts")
        self.rows.dt_s = self.bodies.duct.dt_s
        self._first_new = 0
        self._state.ledger.put_zero("solves")

    def step_arrays(self) -> tuple[AnyArray, ...]:
        """Return the live arrays that a step changes, and the next one goes on from."""
        return *self._state.memory.own_memory(), *self._state.ledger.own_memory()

    def save_start(self) -> None:
        """Save the state at the start of a step beside `step_arrays`."""
        self._saved = self._applied_forces

    def restore_start(self) -> None:
        """Restore it. The last step's rows are lost; their load by tools that have left is stored already."""
        self._applied_forces = self._saved
        self._gone_is_known = True

    def let_go_of_tools(self) -> None:
        """Remove from the duct the last step's forces by tools that have vanished."""
        duct, tools = self.bodies.duct, self.bodies.tools
        if self._applied_forces and tools.have_vanished:
            if not self._gone_is_known:
                k = self.rows.n_contacts
                by = self.rows.tool[:k]
                is_gone = (by != NO_TOOL) & ~tools.present[by]
                self._gone = duct.modal_load(np.where(is_gone[:, None], self.force_n[:k], 0.0))
            duct.remove_half_impulse(self._gone)
        self._gone_is_known = False

    def append(self, pairs: ContactPairs) -> None:
        """Add candidate pairs."""
        self.dropped_pairs += stages.append(pairs.address, self.geometry.address, self.rows.address)

    def complete_rows(self) -> None:
        """Finish gaps and slips with the duct's displacement, and recall last tick's forces."""
        duct = self.bodies.duct
        if duct.kept_address is None:
            duct.gather(*self.rows.on_duct)
        elif stages.gather_and_complete(self.address, duct.loads_address, duct.kept_address):
            return
        else:
            duct.displace(*self.rows.on_duct)
        stages.complete_rows(self.address, duct.displacement_m, duct.motion_m)

    def append_new(self, pairs: ContactPairs) -> None:
        """Add pairs to the rows of a step that was solved; old rows keep forces and friction."""
        duct, self._first_new = self.bodies.duct, self.rows.n_contacts
        self.append(pairs)
        duct.gather(*self.rows.on_duct)
        stages.complete_new(self.address, duct.displacement_m, duct.motion_m, self._first_new)

    @contextmanager
    def old_friction(self) -> Iterator[None]:
        """Restrict changes of friction coefficients to the rows that were added last."""
        first = self._first_new
        kept = self.rows.friction[:first].copy()
        yield
        self.rows.friction[:first] = kept

    def add_duct_motion(self, motion_m: FloatArray) -> None:
        """Let the duct's points of the rows that were completed last move by ``motion_m`` (k, 3) more over the step."""
        stages.subtract_motion(self.address, motion_m, self._first_new)

    def assemble(self) -> None:
        """Gather what the solve needs of the bodies."""
        self.strategy.assemble()

    def solve(self, iterations: int, dt_s: float) -> None:
        """Find the contact forces."""
        self.sweeps = self.strategy.solve(iterations, dt_s)

    def nonlinear_error_j(self) -> float:
        """Return the energy in J by which the solved forces leave the catheter's linearisation; 0.0 if negligible."""
        k = self.rows.n_contacts
        return self.bodies.catheter.nonlinear_error_j(*self.rows.on_rod, self.force_n[:k])

    def relinearise(self, share: float) -> None:
        """Repeat the catheter's step, see `CatheterBody.relinearise`, and update the rows' slips by its new motion."""
        catheter = self.bodies.catheter
        add_rod_motion(self.rows.address, catheter.motion_m, -1.0)
        catheter.relinearise(share)
        add_rod_motion(self.rows.address, catheter.motion_m, 1.0)

    def rest(self) -> None:
        """Forget the forces of the last tick, as nothing touches."""
        self.sweeps = 0
        self._state.memory.n_contacts = 0
        self._state.ledger.begun_s = BEGINS_S

    def forget(self) -> None:
        """Forget the contacts of this step and their forces."""
        self.clear()
        self.rest()
        self._gone_is_known = False

    def apply(self, tool_force: FloatArray) -> None:
        """Give the forces to duct, catheter and, as generalised forces ``tool_force`` (2, 4), to the tools."""
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
            rod.note_factors(stages.give_forces(addresses, rod.addresses, motion, step, *more))
            if rod.twist is not None:
                rod.pay_for_change(catheter.state, catheter.step_address)
            catheter.note_contacts(k)
        else:
            if k or self._applied_forces:  # once more without forces, to remove the last ones
                forces = self.force_n[:k]
                bodies.duct.correct(*rows.on_duct, forces)
                catheter.correct(*rows.on_rod, forces)
            load_tools(self.address, tool_force)
            bodies.tools.correct(tool_force)
        self._applied_forces = k > 0
