"""How deep what jaws hold may be in them before they push it away.

What jaws take hold of may lie in them already: some micrometres of a catheter that they close on, and more of what a
caller tells them to hold, who saw it some steps ago. They let it in no further, and do not throw it out of the hold. A
wall that jaws close on themselves is squeezed between them instead.
"""

from __future__ import annotations

from services.mechanics.collision.pairs import CATHETER_SEGMENT, SHAFT, ContactPairs, pairs_at
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.contact.geometry import ContactGeometry, geometry_at


@kernel
def take_pads(pairs_address: Address[ContactPairs], geometry_address: Address[ContactGeometry], is_told: bool) -> None:
    """Set the pads of jaws that held nothing of a kind at the start of the step; ``is_told`` is whether by a caller."""
    pairs, tools = pairs_at(pairs_address), geometry_at(geometry_address).tools
    for tool in range(tools.held.shape[0]):
        for kind in range(tools.held.shape[1]):
            if not tools.held[tool, kind]:
                tools.pad[tool, kind] = 0.0
    for index in range(pairs.count):
        tool, kind = pairs.tool[index], pairs.target_kind[index]
        is_new = pairs.tool_segment[index] != SHAFT and not tools.held[tool, kind]
        if is_new and (is_told or kind == CATHETER_SEGMENT):
            tools.pad[tool, kind] = max(tools.pad[tool, kind], -pairs.gap_m[index])
