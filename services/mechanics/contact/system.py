"""All contacts of one step: collected, assembled in contact space, solved, and given back to the bodies."""

from __future__ import annotations

from dataclasses import dataclass

from services.mechanics.arrays import FloatArray
from services.mechanics.bodies.catheter import CatheterBody
from services.mechanics.bodies.duct import DuctBody
from services.mechanics.bodies.forceps.tool_body import ToolBody
from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.compiled import Placed
from services.mechanics.contact import stages
from services.mechanics.contact.geometry import ContactGeometry, DuctGeometry, RodGeometry, ToolGeometry
from services.mechanics.contact.state import ContactState
from services.mechanics.scene import ContactSettings


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
        self.bodies = bodies
        self.settings = settings
        duct, catheter, tools = bodies.duct, bodies.catheter, bodies.tools
        self.tool_geometry = ToolGeometry(
            tools.segments, tools.radius_m, tools.frame, tools.length_m, tools.motion, tools.held
        )
        self.rod_geometry = RodGeometry(catheter.start_m, catheter.motion_m, catheter.radius_m)
        mesh = duct.reduced.mesh
        self.duct_geometry = DuctGeometry(mesh.vertices_m, mesh.triangles, bodies.half_thickness_m)
        geometry = ContactGeometry(self.tool_geometry, self.rod_geometry, self.duct_geometry)
        placed = Placed(ContactState.allocate(settings.capacity, duct.state.q.size, geometry))
        self._placed, self._state, self.address = placed, placed.arrays, placed.address
        self.rows = self._state.rows
        self.force_n = self._state.force_n
        self.slides = self._state.slides
        self.dropped = 0
        self.sweeps = 0

    @property
    def motion_m(self) -> FloatArray:
        """(3 k,) gaps and slips at the end of the step, with the solved forces, in the contacts' frames."""
        return self._state.motion[: 3 * self.rows.n_contacts]

    @property
    def compliance_m_n(self) -> FloatArray:
        """(3 k, 3 k) W in the contacts' frames, m/N."""
        size = 3 * self.rows.n_contacts
        view: FloatArray = self._state.compliance[: size * size].reshape(size, size)
        return view

    def clear(self) -> None:
        """Forget the rows of the last step; their forces stay remembered."""
        self.rows.used[0] = 0
        self.dropped = 0

    def append(self, pairs: ContactPairs) -> None:
        """Add candidate pairs."""
        if pairs.count:
            self.dropped += stages.append(self.address, pairs.address, pairs.count)

    def measure(self) -> None:
        """Finish gaps and slips with the duct's displacement, and recall last tick's forces."""
        duct = self.bodies.duct
        duct.gather(self.rows)
        stages.measure(self.address, duct.modes, duct.q_start, duct.dq_free, duct.residual_start, duct.residual_change)

    def assemble(self, n_modes: int) -> None:
        """Gather the lower blocks of W along world axes, with the lowest ``n_modes`` modes of the duct."""
        duct, catheter, rows = self.bodies.duct, self.bodies.catheter, self.rows
        k = rows.n_contacts
        duct.reduced.residual.gather_points(rows.duct_node[:k], rows.duct_weight[:k], self.compliance_m_n)
        modal = (duct.modes, duct.position_gain[:n_modes])
        rod = catheter.compliance(rows)
        stages.add_bodies(self.address, modal, catheter.slot, rod, self.bodies.tools.compliance)

    def finish_compliance(self) -> None:
        """Turn W into the contacts' frames."""
        stages.turn(self.address)

    def solve(self, iterations: int) -> None:
        """Find the contact forces from W."""
        settings = self.settings
        self.sweeps = stages.solve(self.address, settings.recovery, iterations, settings.tolerance_n)

    def push_back(self, dt_s: float) -> None:
        """Find the contact forces from penetrations instead, as the paper does."""
        settings = self.settings
        stages.push_back(self.address, settings.penalty_stiffness_n_m, settings.penalty_damping_n_s_m, dt_s)

    def rest(self) -> None:
        """Forget the forces of the last tick: nothing is touched."""
        self.sweeps = 0
        self._state.memory.used[0] = 0

    def apply(self, tool_force: FloatArray) -> None:
        """Give the forces to duct, catheter and, as generalised forces (2, 4), to the tools."""
        self.bodies.duct.correct(self.rows, self.force_n)
        self.bodies.catheter.correct(self.rows, self.force_n)
        self.bodies.tools.correct(tool_force)
