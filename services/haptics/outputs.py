"""Messages from haptics to physics."""

from __future__ import annotations

from trocar.protocol.bodies import HeldPoint
from trocar.services.mechanics.scene.tools import GraspHold


def hold_body(hold: GraspHold) -> HeldPoint:
    """Return a hold in wire format."""
    a, b, c = hold.target_weights.tolist()
    return HeldPoint(
        hold_id=hold.hold_id,
        tool=hold.tool,
        target_kind=hold.target_kind,
        target=hold.target,
        target_weights=(a, b, c),
        limit_n=hold.limit_n,
        jaw_angle_rad=hold.jaw_angle_rad,
    )
