"""Hypothesis strategies for any body of the wire, from what the body declares."""

from __future__ import annotations

import types
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from hypothesis import strategies as st
from msgspec import Meta

from protocol.arrays import Array, Spec, pack

finite = st.floats(allow_nan=False, allow_infinity=False, width=64, min_value=-1e9, max_value=1e9)


@st.composite
def bodies(draw: st.DrawFn, kind: type[msgspec.Struct]) -> msgspec.Struct:
    """Draw a valid body of `kind`; arrays that share a dimension name share its length."""
    lengths: dict[str, int] = {}
    values = {
        name: draw(_value(hint, lengths, draw)) for name, hint in get_type_hints(kind, include_extras=True).items()
    }
    return kind(**values)


def _value(hint: Any, lengths: dict[str, int], draw: st.DrawFn) -> st.SearchStrategy[Any]:
    extras = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    bare = get_args(hint)[0] if extras else hint
    if bare is Array:
        return _array(next(e for e in extras if isinstance(e, Spec)), lengths, draw)
    return _plain(bare, _limits(extras))


def _limits(extras: tuple[Any, ...]) -> dict[str, Any]:
    limits: dict[str, Any] = {}
    for extra in extras:
        if isinstance(extra, Meta):
            for key in ("ge", "gt", "le", "lt", "max_length"):
                if getattr(extra, key) is not None:
                    limits[key] = getattr(extra, key)
    return limits


def _array(spec: Spec, lengths: dict[str, int], draw: st.DrawFn) -> st.SearchStrategy[Array]:
    shape = [lengths.setdefault(d, draw(st.integers(0, 7))) if isinstance(d, str) else d for d in spec.shape]
    size = int(np.prod(shape))
    item = finite if spec.dtype[1] == "f" else st.integers(-100, 100)
    items = st.lists(item, min_size=size, max_size=size)
    return items.map(lambda flat: pack(np.array(flat, spec.dtype).reshape(shape), spec.dtype))


def _plain(hint: Any, limits: dict[str, Any]) -> st.SearchStrategy[Any]:
    if isinstance(hint, types.UnionType) or get_origin(hint) is Union:
        return st.one_of(*(_plain(part, limits) for part in get_args(hint)))
    if hint is type(None):
        return st.none()
    if hint is bool:
        return st.booleans()
    if hint is int:
        low = limits.get("ge", limits.get("gt", -(1 << 40)))
        high = limits.get("le", limits.get("lt", 1 << 40) - 1)
        return st.integers(low + ("gt" in limits), high)
    if hint is float:
        low, high = limits.get("ge", limits.get("gt", -1e9)), limits.get("le", 1e9)
        return st.floats(low, high, exclude_min="gt" in limits, allow_nan=False)
    if hint is str:
        return st.text(max_size=min(12, limits.get("max_length", 12)))
    if get_origin(hint) is tuple:
        parts = get_args(hint)
        if parts[-1] is Ellipsis:
            return st.lists(_plain(parts[0], {}), max_size=min(3, limits.get("max_length", 3))).map(tuple)
        return st.tuples(*(_plain(part, {}) for part in parts))
    if get_origin(hint) is dict:
        return st.dictionaries(_plain(str, {}), _plain(get_args(hint)[1], {}), max_size=3)
    assert issubclass(hint, msgspec.Struct), hint
    return bodies(hint)
