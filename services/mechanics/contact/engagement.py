"""Tools that appear: they touch nothing until nothing is where they are.

A tool that appears inside something, as one does that was gone for a moment while it pressed, would be pushed out of it
by energy that no hand has put in. So it is limp until it has been withdrawn, or what is there has gone; from then on it
pushes what it meets.
"""

from __future__ import annotations

from services.mechanics.collision.pairs import SHAFT, ContactPairs, pairs_at
from services.mechanics.compiled import kernel
from services.mechanics.compiled.struct import Address
from services.mechanics.contact.geometry import ContactGeometry, ToolGeometry, geometry_at

# Contacts at rest overlap by less; a tool that comes that deep pushes nothing away that is felt. But for thin walls,
# of which that may be all.
CLEAR_M, CLEAR_OF_WALL = 10e-6, 0.125


@kernel
def engage_tools(pairs_address: Address[ContactPairs], geometry_address: Address[ContactGeometry]) -> None:
    """Let the tools among ``waiting`` touch that none of the pairs shows inside something."""
    pairs, geometry = pairs_at(pairs_address), geometry_at(geometry_address)
    tools, clear_m = geometry.tools, min(CLEAR_M, 2.0 * CLEAR_OF_WALL * geometry.wall.half_thickness)
    for tool in range(tools.waiting.shape[0]):
        if tools.waiting[tool] and tools.present[tool]:
            tools.waiting[tool] = _is_inside(pairs, tools, tool, clear_m)


@kernel
def _is_inside(pairs: ContactPairs, tools: ToolGeometry, tool: int, clear_m: float) -> bool:
    for index in range(pairs.count):
        is_held = pairs.tool_segment[index] != SHAFT and tools.held[tool, pairs.target_kind[index]]
        if pairs.tool[index] == tool and not is_held and pairs.gap_m[index] < -clear_m:
            return True
    return False
