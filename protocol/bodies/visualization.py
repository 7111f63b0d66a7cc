"""What the picture's process says: where people who look at the page want the instruments."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from trocar.protocol.vectors import Vec3


class HandTarget(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Where one hand on the page moves its instrument."""

    name: Annotated[str, Meta(max_length=64, description="of the instrument")]
    position_m: Annotated[Vec3, Meta(description="junction of shaft and jaws in the world")]
    roll_rad: Annotated[float, Meta(description="of the jaws about the shaft")] = 0.0
    opening: Annotated[float, Meta(description="of the handle, 0 shut to 1 open; negative: as it is")] = -1.0


class Hands(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """The hands of the page that holds the instruments now; an instrument that is not named stays where it is."""

    hands: Annotated[tuple[HandTarget, ...], Meta(max_length=8)] = ()
    begins: Annotated[
        int, Meta(ge=0, description="gateway.state's, as the page knows it; frames with an older one are ignored")
    ] = 0
    pictures_hz: Annotated[float, Meta(description="pictures a second that this page shows; negative: unknown")] = -1.0
