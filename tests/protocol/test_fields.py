"""What a body declares is found whole; what does not travel is refused by name; numbers are checked in every form."""

from __future__ import annotations

import math
from typing import Annotated, Any

import msgspec
import pytest
from msgspec import Meta

from trocar.protocol.arrays import Array, pack, spec
from trocar.protocol.declared import fault
from trocar.protocol.fields import Field, FieldForm, arrays, fields, nested
from trocar.protocol.soundness import check


class Inner(msgspec.Struct, array_like=True, frozen=True):
    x: float = 0.0


class Every(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    word: Annotated[str, Meta(max_length=4, description="a word")] = ""
    number: Annotated[float, Meta(gt=0.0)] = 1.0
    maybe: float | None = None
    inner: Inner | None = None
    few: Annotated[tuple[Inner, ...], Meta(max_length=2)] = ()
    vector: tuple[float, float] = (0.0, 0.0)
    by_name: dict[str, float] = {}
    inners: dict[str, Inner] = {}
    row: Annotated[Array, spec("<f8", ("n",), "m")] = pack([])


def test_every_form_is_found() -> None:
    assert fields(Every) == (
        Field("word", FieldForm.ONE, str, limits={"max_length": 4}, description="a word"),
        Field("number", FieldForm.ONE, float, limits={"gt": 0.0}),
        Field("maybe", FieldForm.OPTIONAL, float),
        Field("inner", FieldForm.OPTIONAL, Inner),
        Field("few", FieldForm.MANY, Inner, limits={"max_length": 2}),
        Field("vector", FieldForm.FIXED, float, count=2),
        Field("by_name", FieldForm.MAP, float),
        Field("inners", FieldForm.MAP, Inner),
        Field("row", FieldForm.ARRAY, Array, description="m", spec=arrays(Every)[0][1]),
    )
    assert list(nested(Every)) == [Inner]


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        (bytes, "Every.odd: BytesType does not travel"),
        (int | str, "Every.odd: UnionType does not travel"),
        (tuple[int, str], "Every.odd: TupleType does not travel"),
        (dict[int, float], "Every.odd: DictType does not travel"),
        (tuple[tuple[float, ...], ...], "Every.odd: VarTupleType does not travel"),
        (Array, r"Every.odd: an array needs a spec\(dtype, shape, unit\)"),
    ],
)
def test_what_does_not_travel_is_refused_with_its_field(kind: Any, why: str) -> None:
    body = msgspec.defstruct("Every", [("odd", kind)], array_like=True)
    with pytest.raises(TypeError, match=why):
        fields(body)


BAD = [
    {"number": math.nan}, {"maybe": math.inf}, {"inner": Inner(math.nan)}, {"few": (Inner(), Inner(math.inf))},
    {"vector": (0.0, -math.inf)}, {"by_name": {"a": math.nan}}, {"inners": {"a": Inner(math.nan)}},
]  # fmt: skip


@pytest.mark.parametrize("bad", BAD, ids=lambda bad: next(iter(bad)))
def test_a_number_that_is_none_is_seen_in_every_form(bad: dict[str, Any]) -> None:
    body = Every(**bad)
    assert not check(Every, finite_scalars=True)(body)
    assert fault(body, finite_scalars=True) is not None
    assert check(Every, finite_scalars=False)(body)
    assert fault(body, finite_scalars=False) is None


def test_a_sound_body_is_sound() -> None:
    body = Every(maybe=1.0, inner=Inner(2.0), few=(Inner(),), by_name={"a": 1.0}, inners={"a": Inner()})
    assert check(Every, finite_scalars=True)(body)
    assert fault(body, finite_scalars=True) is None
