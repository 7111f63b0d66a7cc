"""How deep a wall that jaws hold may be in them before they push it away.

Jaws that close on a fold meet it at their surface: what is deeper in the tick in which they take hold is an overlap
like any other. What a caller lets them hold may lie in them already: they let it in no further, and do not throw it out
of the hold.
"""

from __future__ import annotations

from services.mechanics.collision.pairs import DUCT_TRIANGLE, SHAFT, ContactPairs, pairs_at
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.contact.geometry import ContactGeometry, geometry_at

# Jaws that close have this little in them.
SHALLOW_M = 0.1e-3


@kernel
def take_pads(pairs_address: Address[ContactPairs], geometry_address: Address[ContactGeometry]) -> None:
    """Set the pads of jaws that held no wall at the start of the step, and are told to by a caller."""
    pairs, tools = pairs_at(pairs_address), geometry_at(geometry_address).tools
    for tool in range(tools.held.shape[0]):
        if not tools.held[tool, DUCT_TRIANGLE]:
            tools.pad[tool] = 0.0
    for index in range(pairs.count):
        tool, depth_m = pairs.tool[index], -pairs.gap_m[index]
        is_jaw_in_wall = pairs.tool_segment[index] != SHAFT and pairs.target_kind[index] == DUCT_TRIANGLE
        if is_jaw_in_wall and not tools.held[tool, DUCT_TRIANGLE] and depth_m > SHALLOW_M:
            tools.pad[tool] = max(tools.pad[tool], depth_m)
