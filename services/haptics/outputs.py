"""What haptics tells physics."""

from __future__ import annotations

from protocol.arrays import pack
from protocol.bodies import GraspHold, ToolContacts, ToolState
from services.mechanics.contact.pairs import ContactPairs


def tool_contacts(
    tick: int, tools: tuple[ToolState, ...], pairs: ContactPairs, holds: tuple[GraspHold, ...] = ()
) -> ToolContacts:
    """Return the first ``pairs.count`` pairs as they travel."""
    n = pairs.count
    return ToolContacts(
        tick=tick,
        tools=tools,
        tool=pack(pairs.tool[:n], "|i1"),
        tool_segment=pack(pairs.tool_segment[:n], "|i1"),
        target_kind=pack(pairs.target_kind[:n], "|i1"),
        target=pack(pairs.target[:n], "<i4"),
        tool_parameter=pack(pairs.tool_parameter[:n]),
        target_weights=pack(pairs.target_weights[:n]),
        normal=pack(pairs.normal[:n]),
        gap_m=pack(pairs.gap_m[:n]),
        holds=holds,
    )
