"""What bodies declare of their numbers, and the check of a decoded body against it.

msgspec checks types, lengths of tuples and ranges while it decodes. What it cannot know is checked here: that an
array's bytes are what its dtype and shape say, that the body's arrays agree, and that no number in a command is NaN.
`protocol.soundness` asks the same of every frame, faster, without saying what is wrong.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import msgspec

from protocol.arrays import Array, Spec


@cache
def decoder(kind: type[msgspec.Struct]) -> msgspec.msgpack.Decoder[Any]:
    """Return the (reused) decoder of `kind`."""
    return msgspec.msgpack.Decoder(kind)


@cache
def array_specs(kind: type[msgspec.Struct]) -> tuple[tuple[str, Spec], ...]:
    """Return the array fields of `kind` with their declarations."""
    found = []
    for name, hint in _hints(kind).items():
        if get_origin(hint) is Annotated and get_args(hint)[0] is Array:
            spec = next((extra for extra in get_args(hint)[1:] if isinstance(extra, Spec)), None)
            if spec is None:
                raise TypeError(f"{kind.__name__}.{name}: an Array field needs a Spec")
            found.append((name, spec))
    return tuple(found)


@cache
def other_fields(kind: type[msgspec.Struct]) -> tuple[tuple[str, Any], ...]:
    """Return name and bare type of the fields that the decoder alone cannot vouch for, arrays left out."""
    bare = {name: _bare(hint) for name, hint in _hints(kind).items()}
    return tuple((name, bare[name]) for name in kind.__struct_fields__ if bare[name] not in (int, str, bool, Array))


def _bare(hint: Any) -> Any:
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


@cache
def _hints(kind: type[msgspec.Struct]) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


def fault(body: msgspec.Struct, *, finite_scalars: bool) -> tuple[str, str] | None:
    """Return ``(reason, detail)`` of the first thing in `body` that breaks its declaration, or None.

    Parameters
    ----------
    body
        A decoded body; bodies nested in it are checked too.
    finite_scalars
        Whether numbers outside arrays must be finite: so for commands.
    """
    kind = type(body)
    lengths: dict[str, int] = {}
    for name, spec in array_specs(kind):
        found = spec.fault(getattr(body, name), lengths)
        if found is not None:
            return found[0], f"{name}: {found[1]}"
    for name, _ in other_fields(kind):
        found = _value_fault(getattr(body, name), name, finite_scalars)
        if found is not None:
            return found
    return None


def _value_fault(value: Any, name: str, finite: bool) -> tuple[str, str] | None:
    if isinstance(value, float):
        return ("not_finite", f"{name} is not a finite number") if finite and not math.isfinite(value) else None
    if isinstance(value, msgspec.Struct):
        return fault(value, finite_scalars=finite)
    if isinstance(value, tuple):
        for item in value:
            found = _value_fault(item, name, finite)
            if found is not None:
                return found
    return None
