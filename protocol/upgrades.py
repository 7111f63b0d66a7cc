"""Old body versions: what they looked like, and how each becomes the next.

A row ``UPGRADES[(topic, version)] = (old body type, lift)`` says how a body of `version` becomes one of the next
version; the old body types are in `trocar.protocol.former`. A field is never reused. A field added at the end with a
default keeps the version; anything else is a new version and a row here, and the old version's golden bytes stay in
``tests/protocol/golden``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec

from trocar.protocol import former
from trocar.protocol.topics import Topic

Upgrade = tuple[type[msgspec.Struct], Callable[[Any], Any]]


def by_name(old: type[msgspec.Struct], new: type[msgspec.Struct]) -> Upgrade:
    """Return the row of an upgrade that keeps the fields that have kept their names; new ones take their default."""
    return old, lambda body: msgspec.convert(body, new, from_attributes=True)


UPGRADES: dict[tuple[str, int], Upgrade] = {
    ("haptics.contact_model", 1): by_name(former.ContactModel1, former.ContactModel2),
    ("haptics.contact_model", 2): (former.ContactModel2, former.ContactModel2.lift),
    ("haptics.contacts", 1): by_name(former.ToolContacts1, former.ToolContacts2),
    ("haptics.contacts", 2): (former.ToolContacts2, former.ToolContacts2.lift),
    ("haptics.contacts", 3): (former.ToolContacts3, former.ToolContacts3.lift),
    ("haptics.contacts", 4): (former.ToolContacts4, former.ToolContacts4.lift),
    ("physics.state", 1): (former.PhysicsState1, former.PhysicsState1.lift),
}


def body_type(row: Topic, version: int) -> type[msgspec.Struct] | None:
    """Return the body type of `version` of a topic, or None if it is not (or no longer) known."""
    if version == row.version:
        return row.body
    old = UPGRADES.get((row.name, version))
    return old[0] if old else None


def lift(row: Topic, version: int, body: Any) -> Any:
    """Return `body` of `version` as one of the row's current version, one upgrade at a time."""
    while version < row.version:
        body = UPGRADES[(row.name, version)][1](body)
        version += 1
    return body
