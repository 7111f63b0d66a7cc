"""Contact loads on the tools: forces, moments about the port, and jaw torque."""

from __future__ import annotations

from typing import Annotated

from services.mechanics.arrays import FloatArray
from services.mechanics.bodies.forceps.kinematics import N_COORDINATES
from services.mechanics.collision.pairs import NO_TOOL
from services.mechanics.compiled import inlined_kernel, kernel
from services.mechanics.compiled.struct import Address, Struct, reader
from services.mechanics.compiled.vectors import along, cross, put_row, subtract
from services.mechanics.compiled.vectors import row as vector
from services.mechanics.contact.laws import HAS_GAP
from services.mechanics.contact.rows import ContactRows
from services.mechanics.contact.state import ContactState, state_at
from services.mechanics.scene.tools import N_TOOLS, ToolResults


class ReportArrays(Struct):
    """Arrays of `ToolResults`, and the generalised contact forces from which they are computed."""

    force: Annotated[FloatArray, N_TOOLS, 3]
    port_moment: Annotated[FloatArray, N_TOOLS, 3]
    grasp_torque: Annotated[FloatArray, N_TOOLS]
    proxy_position: Annotated[FloatArray, N_TOOLS, 3]
    proxy_jaw_angle: Annotated[FloatArray, N_TOOLS]
    loads: Annotated[FloatArray, N_TOOLS, N_COORDINATES]  # generalised contact forces

    @classmethod
    def of(cls, results: ToolResults, loads: FloatArray) -> ReportArrays:
        """View the arrays of ``results``."""
        return cls.zeros(
            force=results.force_n,
            port_moment=results.port_moment_nm,
            grasp_torque=results.grasp_torque_nm,
            proxy_position=results.proxy_position_m,
            proxy_jaw_angle=results.proxy_jaw_angle_rad,
            loads=loads,
        )


report_at = reader(ReportArrays)


@kernel
def load_tools(state_address: Address[ContactState], out: FloatArray) -> None:
    """Write the sum of G^T f of each tool into ``out`` (2, 4): force at J in N, opening torque in N m; G are levers."""
    state = state_at(state_address)
    rows = state.rows
    out[:] = 0.0
    for row in range(rows.n_contacts):
        tool = rows.tool[row]
        if tool == NO_TOOL:
            continue
        for coordinate in range(out.shape[1]):
            for axis in range(3):
                out[tool, coordinate] += rows.lever[row, axis, coordinate] * state.force_n[row, axis]


@kernel
def report(state_address: Address[ContactState], report_address: Address[ReportArrays]) -> float:
    """Write the tools' loads and poses; return the catheter's deepest overlap (m) at the start of the step.

    The overlap is that with the wall or with itself.
    """
    state, out = state_at(state_address), report_at(report_address)
    tools = state.geometry.tools
    _moments(state.rows, state.force_n, tools.port, out.port_moment)
    for tool in range(out.loads.shape[0]):
        out.grasp_torque[tool] = out.loads[tool, 3]
        for axis in range(3):
            out.force[tool, axis] = out.loads[tool, axis]
            out.proxy_position[tool, axis] = tools.proxy[tool, axis]
        out.proxy_jaw_angle[tool] = tools.proxy[tool, 3]
    return _deepest_overlap(state.rows)


@kernel
def _moments(rows: ContactRows, forces: FloatArray, about: FloatArray, moment: FloatArray) -> None:
    """Write the moment (2, 3), in N m, of the forces on each tool about its point in ``about`` (2, 3)."""
    moment[:] = 0.0
    for row in range(rows.n_contacts):
        tool = rows.tool[row]
        if tool == NO_TOOL:
            continue
        arm = subtract(vector(rows.point_m, row), vector(about, tool))
        put_row(moment, tool, along(vector(moment, tool), cross(arm, vector(forces, row)), 1.0))


@inlined_kernel
def _deepest_overlap(rows: ContactRows) -> float:
    deepest = 0.0
    for row in range(rows.n_contacts):
        if HAS_GAP[rows.law[row]] and rows.tool[row] == NO_TOOL:
            deepest = max(deepest, -rows.gap_m[row])
    return deepest
