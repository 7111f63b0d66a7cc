"""All contacts of one step: collected, assembled in contact space, solved, and given back to the bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from services.mechanics.catheter_body import CatheterBody
from services.mechanics.contact.compliance import (
    add_lower,
    add_rod_compliance,
    add_tool_compliance,
    free_motion,
    modal_compliance,
    to_contact_frames,
    world_forces,
)
from services.mechanics.contact.geometry import (
    DuctGeometry,
    PairArrays,
    RodGeometry,
    ToolGeometry,
    append_pairs,
    subtract_duct_motion,
)
from services.mechanics.contact.pairs import ContactPairs
from services.mechanics.contact.penalty import penalty_forces
from services.mechanics.contact.rows import ContactRows
from services.mechanics.contact.solver import SolverScratch, mark_sliding, solve_contacts
from services.mechanics.contact.warm_start import ForceMemory, recall_forces, store_forces
from services.mechanics.duct_body import DuctBody
from services.mechanics.forceps.tool_body import ToolBody
from services.mechanics.scene import ContactSettings

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Bodies:
    """Everything that contacts can push."""

    duct: DuctBody
    catheter: CatheterBody
    tools: ToolBody
    half_thickness_m: float


class ContactSystem:
    r"""Contact rows, their compliance W and the solved forces of one step.

    Positions are those of the start of the step; motions, gaps and forces refer to its end:
    :math:`u^+ = u_{free} + W f` with :math:`W = J A^{-1} J^T` summed over duct (modes and residual compliance),
    catheter (banded inverse) and tools (virtual coupling). Every force acts on both its bodies.

    Attributes
    ----------
    rows : ContactRows
    force_n : (C, 3) float64
        Forces on the first bodies along world axes.
    slides : (C,) bool
        Whether a contact slid, or a hold slipped, in the last solve.
    dropped : int
        Pairs that found no room in this step.
    sweeps : int
        Sweeps that the last solve took.
    """

    def __init__(self, bodies: Bodies, settings: ContactSettings) -> None:
        capacity = settings.capacity
        self.bodies = bodies
        self.settings = settings
        self.rows = ContactRows.allocate(capacity)
        self.force_n = np.zeros((capacity, 3))
        self.slides = np.zeros(capacity, np.bool_)
        self.dropped = 0
        self.sweeps = 0
        self._memory = ForceMemory.allocate(capacity)
        self._w = np.zeros(9 * capacity * capacity)
        self._residual = np.zeros(9 * capacity * capacity)
        self._motion = np.zeros(3 * capacity)
        self._scratch = SolverScratch.allocate(3 * capacity)
        duct, catheter, tools = bodies.duct, bodies.catheter, bodies.tools
        self.tool_geometry = ToolGeometry(
            tools.segments, tools.radius_m, tools.frame, tools.length_m, tools.motion, tools.held
        )
        self.rod_geometry = RodGeometry(catheter.start_m, catheter.motion_m, catheter.radius_m)
        mesh = duct.reduced.mesh
        self.duct_geometry = DuctGeometry(mesh.vertices_m, mesh.triangles, bodies.half_thickness_m)

    @property
    def motion_m(self) -> FloatArray:
        """(3 k,) gaps and slips at the end of the step, with the solved forces, in the contacts' frames."""
        return self._motion[: 3 * self.rows.n_contacts]

    @property
    def compliance_m_n(self) -> FloatArray:
        """(3 k, 3 k) W in the contacts' frames, m/N."""
        size = 3 * self.rows.n_contacts
        view: FloatArray = self._w[: size * size].reshape(size, size)
        return view

    def clear(self) -> None:
        """Forget the rows of the last step; their forces stay remembered."""
        self.rows.used[0] = 0
        self.dropped = 0

    def append(self, pairs: ContactPairs) -> None:
        """Add candidate pairs."""
        arrays = PairArrays.of(pairs)
        geometry = self.tool_geometry, self.rod_geometry, self.duct_geometry
        self.dropped += append_pairs(arrays, pairs.count, *geometry, self.rows)

    def measure(self) -> None:
        """Finish gaps and slips with the duct's displacement, and recall last tick's forces."""
        duct, rows = self.bodies.duct, self.rows
        duct.gather(rows)
        subtract_duct_motion(rows, duct.modes, duct.q_start, duct.dq_free, duct.residual_start, duct.residual_change)
        recall_forces(self._memory, rows, self.slides)

    def assemble(self, n_modes: int) -> None:
        """Gather the lower blocks of W along world axes, with the lowest ``n_modes`` modes of the duct."""
        duct, rows = self.bodies.duct, self.rows
        k = rows.n_contacts
        size = 3 * k
        W = self.compliance_m_n
        residual = self._residual[: size * size].reshape(size, size)
        modal_compliance(duct.modes[:size], duct.position_gain[:n_modes], duct.scratch, W)
        duct.reduced.residual.gather_points(rows.duct_node[:k], rows.duct_weight[:k], residual)
        add_lower(residual, W)
        add_rod_compliance(rows, self.bodies.catheter.slot, self.bodies.catheter.compliance(rows), W)
        add_tool_compliance(rows, self.bodies.tools.compliance, W)

    def finish_compliance(self) -> None:
        """Turn W into the contacts' frames."""
        to_contact_frames(self.rows, self.compliance_m_n)

    def solve(self, iterations: int) -> None:
        """Find the contact forces from W."""
        rows = self.rows
        k = rows.n_contacts
        free_motion(rows, self.settings.recovery, self._motion)
        force = rows.force_n[:k].reshape(-1)
        effort = (iterations, self.settings.tolerance_n)
        self.sweeps = solve_contacts(
            self.compliance_m_n, self.motion_m, rows.kind[:k], rows.limit[:k], force, effort, self._scratch
        )
        self._finish()

    def push_back(self, dt_s: float) -> None:
        """Find the contact forces from penetrations instead, as the paper does."""
        settings = self.settings
        free_motion(self.rows, 1.0, self._motion)
        penalty_forces(self.rows, settings.penalty_stiffness_n_m, settings.penalty_damping_n_s_m, dt_s)
        self._finish()

    def rest(self) -> None:
        """Forget the forces of the last tick: nothing is touched."""
        self.sweeps = 0
        self._memory.used[0] = 0

    def _finish(self) -> None:
        rows = self.rows
        k = rows.n_contacts
        mark_sliding(rows.kind[:k], rows.limit[:k], rows.force_n[:k].reshape(-1), self.slides)
        world_forces(rows, self.force_n)
        store_forces(self._memory, rows, self.force_n, self.slides)

    def apply(self, tool_force: FloatArray) -> None:
        """Give the forces to duct, catheter and, as generalised forces (2, 4), to the tools."""
        self.bodies.duct.correct(self.rows, self.force_n)
        self.bodies.catheter.correct(self.rows, self.force_n)
        self.bodies.tools.correct(tool_force)
