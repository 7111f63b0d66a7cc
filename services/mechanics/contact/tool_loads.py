"""Contact loads on the tools: forces, jaw torque, and moments about the port."""

from __future__ import annotations

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.collision.pairs import NO_TOOL
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.compiled.vectors import along, cross, put_row, subtract
from trocar.services.mechanics.compiled.vectors import row as vector
from trocar.services.mechanics.contact.laws import HAS_GAP
from trocar.services.mechanics.contact.state import ContactState, state_at


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
def report(state_address: Address[ContactState], tool_force: FloatArray, out: tuple[FloatArray, ...]) -> float:
    """Write what each tool feels, with generalised forces ``tool_force`` (2, 4), and where its proxy is.

    ``out`` is (force, moment about the port, torque of the jaws, proxy's position, its opening), as in `ToolResults`.
    Return the catheter's deepest overlap (m), with the wall or with itself, at the start of the step.
    """
    state, deepest_m, moment = state_at(state_address), 0.0, out[1]
    rows, port, proxy = state.rows, state.geometry.tools.port, state.geometry.tools.proxy
    for tool in range(moment.shape[0]):
        for axis in range(3):
            out[0][tool, axis], moment[tool, axis] = tool_force[tool, axis], 0.0
            out[3][tool, axis] = proxy[tool, axis]
        out[2][tool], out[4][tool] = tool_force[tool, 3], proxy[tool, 3]
    for row in range(rows.n_contacts):
        tool = rows.tool[row]
        if tool != NO_TOOL:
            arm = subtract(vector(rows.point_m, row), vector(port, tool))
            put_row(moment, tool, along(vector(moment, tool), cross(arm, vector(state.force_n, row)), 1.0))
        elif HAS_GAP[rows.law[row]]:
            deepest_m = max(deepest_m, -rows.gap_m[row])
    return deepest_m
