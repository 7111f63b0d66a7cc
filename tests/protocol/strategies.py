"""Hypothesis strategies for any body of the wire, from what the body declares."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
from hypothesis import strategies as st

from trocar.protocol.arrays import Array, Spec, pack
from trocar.protocol.fields import Field, FieldForm, fields

finite = st.floats(allow_nan=False, allow_infinity=False, width=64, min_value=-1e9, max_value=1e9)


@st.composite
def bodies(draw: st.DrawFn, kind: type[msgspec.Struct]) -> msgspec.Struct:
    """Draw a valid body of `kind`; arrays that share a dimension name share its length."""
    lengths: dict[str, int] = {}
    return kind(**{field.name: draw(_value(field, lengths, draw)) for field in fields(kind)})


def _value(field: Field, lengths: dict[str, int], draw: st.DrawFn) -> st.SearchStrategy[Any]:
    if field.spec is not None:
        return _array(field.spec, lengths, draw)
    item = _item(field)
    longest = int(min(3, field.limits.get("max_length", 3)))
    if field.form is FieldForm.OPTIONAL:
        return st.none() | item
    if field.form is FieldForm.MANY:
        return st.lists(item, max_size=longest).map(tuple)
    if field.form is FieldForm.FIXED:
        return st.tuples(*[item] * field.count)
    if field.form is FieldForm.MAP:
        return st.dictionaries(st.text(max_size=12), item, max_size=longest)
    return item


def _array(spec: Spec, lengths: dict[str, int], draw: st.DrawFn) -> st.SearchStrategy[Array]:
    shape = [lengths.setdefault(d, draw(st.integers(0, 7))) if isinstance(d, str) else d for d in spec.shape]
    size = int(np.prod(shape))
    item = finite if spec.dtype[1] == "f" else st.integers(-100, 100)
    items = st.lists(item, min_size=size, max_size=size)
    return items.map(lambda flat: pack(np.array(flat, spec.dtype).reshape(shape), spec.dtype))


def _item(field: Field) -> st.SearchStrategy[Any]:
    limits = field.limits
    if field.body is not None:
        return bodies(field.body)
    if field.item is bool:
        return st.booleans()
    if field.item is int:
        low = limits.get("ge", limits.get("gt", -(1 << 40)))
        high = limits.get("le", limits.get("lt", 1 << 40) - 1)
        return st.integers(int(low) + ("gt" in limits), int(high))
    if field.item is float:
        low, high = limits.get("ge", limits.get("gt", -1e9)), limits.get("le", 1e9)
        return st.floats(low, high, exclude_min="gt" in limits, allow_nan=False)
    assert field.item is str, field
    return st.text(max_size=int(min(12, limits.get("max_length", 12))) if field.form is FieldForm.ONE else 12)
