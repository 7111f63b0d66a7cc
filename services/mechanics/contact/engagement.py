"""Engagement of tools: a tool that appears inside a body has no contacts until it is clear of the body.

A tool appears inside a body if it was absent for a moment while it pressed. A contact would push it out with energy
that no hand has supplied. So the tool is disengaged until it has been withdrawn, or the body has moved away.

A body may overlap the jaws when a hold of it begins: by micrometres if jaws close on a catheter, by more if a caller
requests a hold from a state some steps old. This overlap becomes the rest offset of the contact: it causes no force,
and it may not grow. If the simulation itself decides that jaws hold the wall, the wall is squeezed instead (`squeeze`).
"""

from __future__ import annotations

from trocar.services.mechanics.bodies.forceps.kinematics import N_SEGMENTS
from trocar.services.mechanics.collision.candidates import Candidates
from trocar.services.mechanics.collision.pairs import CATHETER_SEGMENT, SHAFT, ContactPairs, pairs_at
from trocar.services.mechanics.compiled import kernel
from trocar.services.mechanics.compiled.struct import Address
from trocar.services.mechanics.contact.geometry import ContactGeometry, geometry_at
from trocar.services.mechanics.contact.working_set import SHARE_OF_WALL

# Largest overlap of a tool that engages: contacts at rest overlap by less, and the force at this depth is not felt.
CLEAR_M = 10e-6


@kernel
def engage_tools(found: Candidates, pairs: ContactPairs, geometry: ContactGeometry) -> None:
    """Engage the disengaged tools that overlap neither the wall (candidates) nor the catheter (pairs)."""
    tools, clear_m = geometry.tools, min(CLEAR_M, 2.0 * SHARE_OF_WALL * geometry.wall.half_thickness)
    for tool in range(tools.disengaged.shape[0]):
        if not tools.disengaged[tool] or not tools.present[tool]:
            continue
        deepest_m = 0.0
        for i in range(found.count):
            if found.piece[i] // N_SEGMENTS == tool:
                deepest_m = max(deepest_m, -found.gap_m[i])
        for index in range(pairs.count):
            if pairs.tool[index] == tool:
                deepest_m = max(deepest_m, -pairs.gap_m[index])
        tools.disengaged[tool] = deepest_m > clear_m


@kernel
def set_rest_offsets(
    pairs_address: Address[ContactPairs], geometry: Address[ContactGeometry], is_requested: bool
) -> None:
    """Set the rest offsets of jaws that begin to hold a kind of target, from the overlaps (m) of their pairs.

    ``is_requested`` is whether a caller requested the hold; only then walls get a rest offset.
    """
    pairs, tools = pairs_at(pairs_address), geometry_at(geometry).tools
    for tool in range(tools.held.shape[0]):
        for kind in range(tools.held.shape[1]):
            if not tools.held[tool, kind]:
                tools.rest_offset[tool, kind] = 0.0
    for index in range(pairs.count):
        tool, kind = pairs.tool[index], pairs.target_kind[index]
        is_new = pairs.tool_segment[index] != SHAFT and not tools.held[tool, kind]
        if is_new and (is_requested or kind == CATHETER_SEGMENT):
            tools.rest_offset[tool, kind] = max(tools.rest_offset[tool, kind], -pairs.gap_m[index])
