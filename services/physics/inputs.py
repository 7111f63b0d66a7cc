"""Reads ``haptics.contacts`` into the arrays of the mechanics, and checks the indices of grasps for kernels."""

from __future__ import annotations

from operator import attrgetter
from typing import Annotated

import numpy as np

from trocar.protocol.arrays import Array
from trocar.protocol.bodies import HeldPoint, ToolContacts
from trocar.protocol.bodies.haptics import TOOL_COLUMNS, TOOL_OPENING, TOOL_PORT, TOOL_POSITION, TOOL_ROLL, tool_table
from trocar.services.mechanics.arrays import BoolArray, FloatArray
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, DUCT_TRIANGLE
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.scene.tools import N_TOOLS, GraspHold, ToolInputs
from trocar.services.mechanics.simulation import Simulation
from trocar.services.runtime.loop.flat_view import flat_view

_TOOL_BYTES = TOOL_COLUMNS * np.dtype(float).itemsize


class ToolTable(Struct):
    """The tools' table of a frame in wire format, and the arrays that it is copied to."""

    tools: Annotated[FloatArray, N_TOOLS, TOOL_COLUMNS]
    present: Annotated[BoolArray, N_TOOLS]
    port: Annotated[FloatArray, N_TOOLS, 3]
    position: Annotated[FloatArray, N_TOOLS, 3]
    roll: Annotated[FloatArray, N_TOOLS]
    opening: Annotated[FloatArray, N_TOOLS]


table_at = reader(ToolTable)


class ContactsReader:
    """Holds the tools and grasps of the newest accepted frame.

    Attributes:
        tools: Inputs of a step, overwritten in place by `take`.
        refused: Number of frames with a grasp of an unknown target.
    """

    def __init__(self, simulation: Simulation) -> None:
        self.tools = ToolInputs()
        self.refused = 0
        n_triangles = simulation.duct.reduced.mesh.triangles.shape[0]
        n_segments = simulation.catheter.state.position_m.shape[0] - 1
        self._most = {DUCT_TRIANGLE: n_triangles, CATHETER_SEGMENT: n_segments}
        self._holds: dict[int, tuple[HeldPoint, GraspHold]] = {}
        self._table = ToolTable.zeros(
            present=self.tools.present,
            port=simulation.tools.port_m,
            position=self.tools.position_m,
            roll=self.tools.roll_rad,
            opening=self.tools.jaw_angle_rad,
        )
        self._bytes = flat_view(self._table.tools).cast("B")

    def read_contacts(self, body: ToolContacts) -> bool:
        """Copy `body` into `tools`; return False, without copying, if it names an unknown target."""
        if body.holds and not all(map(self._is_there, body.holds)):
            self.refused += 1
            return False
        self._take_table(body.tools)
        if body.withdrawn:
            self.tools.present &= [not body.withdrawn >> tool & 1 for tool in range(N_TOOLS)]
        self._take_holds(body.holds)
        return True

    def _take_table(self, tools: Array) -> None:
        """Copy the table's bytes into an existing array, which is four times as fast as making one of them."""
        data = tools.data[: N_TOOLS * _TOOL_BYTES]
        self._bytes[: len(data)] = data
        copy_tools(self._table.address, len(data) // _TOOL_BYTES)

    def compile_kernels(self) -> None:
        """Read an empty frame as it comes off the wire."""
        self.read_contacts(ToolContacts(tick=0, tools=tool_table(())))

    def _is_there(self, hold: HeldPoint) -> bool:
        return hold.tool < N_TOOLS and hold.target < self._most[hold.target_kind]

    def _take_holds(self, holds: tuple[HeldPoint, ...]) -> None:
        self.tools.holds = [self._hold(hold) for hold in holds] if holds else []
        if len(self._holds) > len(holds):
            self._holds = {hold.hold_id: self._holds[hold.hold_id] for hold in holds}

    def _hold(self, body: HeldPoint) -> GraspHold:
        """Return the hold of this number, the same object as before unless it holds something else."""
        known = self._holds.get(body.hold_id)
        if known is None or _held_by(known[0]) != _held_by(body):
            hold = GraspHold(body.hold_id, body.tool, body.target_kind, body.target, _weights(body), 0.0, 0.0)
            known = self._holds[body.hold_id] = body, hold
        hold = known[1]
        hold.limit_n, hold.jaw_angle_rad = body.limit_n, body.jaw_angle_rad
        return hold


@kernel
def copy_tools(address: Address[ToolTable], n_tools: int) -> None:
    """Copy the rows of present tools; the last pose of an absent one is kept."""
    table = table_at(address)
    rows = table.tools
    for tool in range(rows.shape[0]):
        table.present[tool] = tool < n_tools
        if tool < n_tools:
            for axis in range(3):
                table.position[tool, axis] = rows[tool, TOOL_POSITION + axis]
                table.port[tool, axis] = rows[tool, TOOL_PORT + axis]
            table.roll[tool], table.opening[tool] = rows[tool, TOOL_ROLL], rows[tool, TOOL_OPENING]


_held_by = attrgetter("tool", "target_kind", "target", "target_weights")


def _weights(body: HeldPoint) -> FloatArray:
    if body.target_kind == CATHETER_SEGMENT:
        return np.array([*body.target_weights[:2], 0.0])
    return np.array(body.target_weights)
