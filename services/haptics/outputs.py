"""What haptics tells physics."""

from __future__ import annotations

from protocol.arrays import pack
from protocol.bodies import GraspHold as HoldBody
from protocol.bodies import ToolContacts, ToolState
from services.mechanics.collision.pairs import TOOL_COLUMNS, ContactPairs
from services.mechanics.scene.tools import GraspHold


def tool_contacts(tick: int, tools: tuple[ToolState, ...], pairs: ContactPairs, holds: list[GraspHold]) -> ToolContacts:
    """Return tools, the first ``pairs.count`` pairs, and the grasps in force as they travel."""
    columns = {name: getattr(pairs, name)[: pairs.count] for name in TOOL_COLUMNS}
    return ToolContacts(
        tick=tick,
        tools=tools,
        holds=tuple(_hold(hold) for hold in holds),
        **{name: pack(column, column.dtype.str) for name, column in columns.items()},
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
