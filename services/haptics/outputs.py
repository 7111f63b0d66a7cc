"""What haptics tells physics."""

from __future__ import annotations

from protocol.arrays import pack
from protocol.bodies import GraspHold as HoldBody
from protocol.bodies import ToolContacts, ToolState
from services.mechanics.collision.pairs import ContactPairs
from services.mechanics.scene.tools import GraspHold


def tool_contacts(tick: int, tools: tuple[ToolState, ...], pairs: ContactPairs, holds: list[GraspHold]) -> ToolContacts:
    """Return tools, the first ``pairs.count`` pairs, and the grasps in force as they travel."""
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
        holds=tuple(_hold(hold) for hold in holds),
    )


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
