"""What haptics tells physics."""

from __future__ import annotations

import numpy as np

from protocol.arrays import Array, pack
from protocol.bodies import GraspHold as HoldBody
from protocol.bodies import ToolContacts
from protocol.bodies.haptics import (
    PAIR_GAP,
    PAIR_GEOMETRY,
    PAIR_INDICES,
    PAIR_KIND,
    PAIR_NORMAL,
    PAIR_PARAMETER,
    PAIR_SEGMENT,
    PAIR_TARGET,
    PAIR_TOOL,
    PAIR_WEIGHTS,
)
from services.mechanics.arrays import FloatArray, IntArray
from services.mechanics.collision.pairs import ContactPairs, pairs_at
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.scene.tools import GraspHold


class ContactsWriter:
    """Makes the frame of tools and contact pairs.

    Parameters
    ----------
    pairs
        What collision detection fills.
    """

    def __init__(self, pairs: ContactPairs) -> None:
        self._pairs = pairs
        self._index = np.zeros((pairs.capacity, PAIR_INDICES), np.int32)
        self._geometry = np.zeros((pairs.capacity, PAIR_GEOMETRY))

    def body(self, tick: int, tools: Array, holds: list[GraspHold], begins: int = 0) -> ToolContacts:
        """Return tools, the pairs in use, and the grasps in force as they travel."""
        count = tabulate_pairs(self._pairs.address, self._index, self._geometry)
        return ToolContacts(
            tick=tick,
            tools=tools,
            pair_index=pack(self._index[:count], "<i4"),
            pair_geometry=pack(self._geometry[:count]),
            holds=tuple(map(_hold, holds)),
            begins=begins,
        )


@kernel
def tabulate_pairs(address: Address[ContactPairs], index: IntArray, geometry: FloatArray) -> int:
    """Write the pairs into tables of the wire, a row each, and return how many there are."""
    pairs = pairs_at(address)
    for row in range(pairs.count):
        index[row, PAIR_TOOL], index[row, PAIR_SEGMENT] = pairs.tool[row], pairs.tool_segment[row]
        index[row, PAIR_KIND], index[row, PAIR_TARGET] = pairs.target_kind[row], pairs.target[row]
        geometry[row, PAIR_PARAMETER], geometry[row, PAIR_GAP] = pairs.tool_parameter[row], pairs.gap_m[row]
        for axis in range(3):
            geometry[row, PAIR_WEIGHTS + axis] = pairs.target_weights[row, axis]
            geometry[row, PAIR_NORMAL + axis] = pairs.normal[row, axis]
    return int(pairs.count)


def _hold(hold: GraspHold) -> HoldBody:
    a, b, c = hold.target_weights.tolist()
    return HoldBody(
        hold_id=hold.hold_id,
        tool=hold.tool,
        target_kind=hold.target_kind,
        target=hold.target,
        target_weights=(a, b, c),
        limit_n=hold.limit_n,
        jaw_angle_rad=hold.jaw_angle_rad,
    )
