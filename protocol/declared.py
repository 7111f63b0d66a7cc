"""What bodies declare of their numbers, and the check of a decoded body against it.

msgspec checks types, lengths of tuples and ranges while it decodes. What it cannot know is checked here: that an
array's bytes are what its dtype and shape say, that the body's arrays agree, and that no number in a command is NaN.
`trocar.protocol.soundness` asks the same of every frame, faster, without saying what is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache
from typing import Any

import msgspec

from trocar.protocol.fields import Field, FieldForm, fields


@cache
def decoder(kind: type[msgspec.Struct]) -> msgspec.msgpack.Decoder[Any]:
    """Return the (reused) decoder of `kind`."""
    return msgspec.msgpack.Decoder(kind)


def fault(body: msgspec.Struct, *, finite_scalars: bool) -> tuple[str, str] | None:
    """Return ``(reason, detail)`` of the first thing in `body` that breaks its declaration, or None.

    Args:
        body: A decoded body; bodies nested in it are checked too.
        finite_scalars: Whether numbers outside arrays must be finite: so for commands.
    """
    lengths: dict[str, int] = {}
    for field in fields(type(body)):
        found = _fault(field, getattr(body, field.name), lengths, finite_scalars)
        if found is not None:
            return found
    return None


def _fault(field: Field, value: Any, lengths: dict[str, int], finite: bool) -> tuple[str, str] | None:
    if field.spec is not None:
        found = field.spec.fault(value, lengths)
        return found and (found[0], f"{field.name}: {found[1]}")
    for item in _items(field, value):
        if field.body is not None:
            within = fault(item, finite_scalars=finite)
            if within is not None:
                return within
        elif finite and field.item is float and not math.isfinite(item):
            return "not_finite", f"{field.name} is not a finite number"
    return None


def _items(field: Field, value: Any) -> Iterable[Any]:
    if field.form is FieldForm.ONE:
        return (value,)
    if field.form is FieldForm.OPTIONAL:
        return () if value is None else (value,)
    return value.values() if field.form is FieldForm.MAP else value  # type: ignore[no-any-return]
