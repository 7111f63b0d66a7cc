"""The tools of a device frame as bodies: proxies, displaced from the hands by contact, and their segments."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from trocar.protocol.arrays import Array
from trocar.protocol.bodies.haptics import TOOL_COLUMNS, TOOL_OPENING, TOOL_PORT, TOOL_POSITION, TOOL_ROLL
from trocar.protocol.bodies.physics import REACTION_COLUMNS, REACTION_POSITION, REACTION_PROXY, REACTION_PROXY_OPENING
from trocar.services.haptics.instruments import HANDLE, INSTRUMENT_COLUMNS, PORT, ROLL
from trocar.services.haptics.reactions import is_held
from trocar.services.mechanics.arrays import BoolArray, FloatArray
from trocar.services.mechanics.bodies.forceps.grasp import JawState
from trocar.services.mechanics.bodies.forceps.tool_body import ToolArrays, ToolBody, tools_at, update_poses
from trocar.services.mechanics.compiled import inlined_kernel, kernel
from trocar.services.mechanics.compiled.struct import Address, Struct, reader
from trocar.services.mechanics.scene import SceneModel
from trocar.services.mechanics.scene.tools import N_TOOLS


class HandTables(Struct):
    """Inputs of the tools' poses, whether they are present, and their table for physics."""

    reactions: Annotated[FloatArray, N_TOOLS, REACTION_COLUMNS]
    instruments: Annotated[FloatArray, N_TOOLS, INSTRUMENT_COLUMNS]
    jaw_ratio: Annotated[FloatArray, N_TOOLS]
    jaw_max_angle: Annotated[FloatArray, N_TOOLS]
    present: Annotated[BoolArray, N_TOOLS]
    table: Annotated[FloatArray, N_TOOLS, TOOL_COLUMNS]


hands_at = reader(HandTables)


class ToolTracker:
    """Tracks the hands from device frames and the proxies from physics.

    Between two frames of physics a proxy moves with its hand, as the coupling's stretch from physics is kept.

    Args:
        scene: The scene of the tools.
        reactions: (2, REACTION_COLUMNS), instruments: (2, INSTRUMENT_COLUMNS). Live tables of solved forces and of the
            hands' states.

    Attributes:
        segments_m: (2, 3, 2, 3), radius_m: (2, 3), present: (2,). Inputs of collision detection.
    """

    def __init__(self, scene: SceneModel, reactions: FloatArray, instruments: FloatArray) -> None:
        self._body = ToolBody(scene.forceps)
        ranges = np.array([tool.handle_range for tool in self._body.forceps])
        self.segments_m = self._body.segments
        self.radius_m = self._body.radius_m
        self.present = np.zeros(N_TOOLS, np.bool_)
        self._table = np.zeros((N_TOOLS, TOOL_COLUMNS))
        self._hands = HandTables(
            reactions=reactions,
            instruments=instruments,
            jaw_ratio=ranges[:, 0].copy(),
            jaw_max_angle=ranges[:, 1].copy(),
            present=self.present,
            table=self._table,
        )

    def update_pose(self) -> None:
        """Recompute the segments from the proxies."""
        self._body.update_pose()

    def take_hands(self, n_instruments: int) -> Array:
        """Move the tools to the first rows of the instruments, and return their table for physics."""
        follow_hands(self._hands.address, self._body.address, n_instruments)
        return Array("<f8", (n_instruments, TOOL_COLUMNS), self._table[:n_instruments].tobytes())

    def jaws(self, i: int) -> JawState:
        """Return opening and commanded opening of the jaws of tool `i`."""
        return JawState(self._body.proxy.item(i, 3), self._table.item(i, TOOL_OPENING))


@kernel
def follow_hands(hands_address: Address[HandTables], tools_address: Address[ToolArrays], n: int) -> None:
    """Place ``n`` proxies, with frames and segments, and write the table for physics; other tools are absent."""
    hands, tools = hands_at(hands_address), tools_at(tools_address)
    for tool in range(hands.present.shape[0]):
        hands.present[tool] = tool < n
        if tool < n:
            _follow_hand(hands, tools, tool)
    update_poses(tools_address)


@inlined_kernel
def _follow_hand(hands: HandTables, tools: ToolArrays, tool: int) -> None:
    """Place a proxy. A body between the jaws keeps them open."""
    hand, solved, table = hands.instruments[tool], hands.reactions[tool], hands.table[tool]
    held = is_held(hands.reactions, tool)
    opening = min(max(hands.jaw_ratio[tool] * hand[HANDLE], 0.0), hands.jaw_max_angle[tool])
    for axis in range(3):
        stretch = solved[REACTION_PROXY + axis] - solved[REACTION_POSITION + axis] if held else 0.0
        tools.port[tool, axis] = table[TOOL_PORT + axis] = hand[PORT + axis]
        tools.proxy[tool, axis] = hand[axis] + stretch
        table[TOOL_POSITION + axis] = hand[axis]
    tools.roll[tool] = table[TOOL_ROLL] = hand[ROLL]
    tools.proxy[tool, 3] = solved[REACTION_PROXY_OPENING] if held else opening
    table[TOOL_OPENING] = opening
