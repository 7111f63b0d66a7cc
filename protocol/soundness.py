"""Whether a decoded body is what it declares: the check that every frame passes, made once per body type.

`declared.fault` walks a body and names what is wrong with it; that takes longer than decoding. Here the walk is done
once, over the type, and what is left for each frame are a few calls: a norm is finite only if every number is, the
numbers of all arrays are taken together, and a layout of arrays that was found good once is known. A body that does not
pass may still be faultless (the norm of finite numbers can be infinite): `declared.fault` has the last word.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from itertools import chain
from math import hypot, isfinite
from operator import attrgetter
from typing import Any

import msgspec
import numpy as np

from trocar.protocol.arrays import MAX_DIMENSION, Array, Spec
from trocar.protocol.fields import Field, FieldForm, fields, nested

Check = Callable[[Any], bool]
Leaf = tuple[str, Field]
#: Of each array dtype and shape, and then of each the number of bytes.
Layout = tuple[tuple[tuple[str, tuple[int, ...]], ...], tuple[int, ...]]

#: Layouts that are remembered of a body type: those of a rig's contacts come and go, and forgotten ones are taken apart
#: again, so that memory does not grow.
_LAYOUTS = 256
#: Checks that are asked in one expression, written out; more are asked by threes.
_AT_ONCE = 3
_kind, _data = attrgetter("dtype", "shape"), attrgetter("data")


@cache
def check(kind: type[msgspec.Struct], *, finite_scalars: bool, finite_arrays: bool = True) -> Check:
    """Return the check of bodies of `kind`.

    Args:
        kind: A body type, or one that bodies hold.
        finite_scalars: Whether numbers outside arrays must be finite: so for commands.
        finite_arrays: Whether those of arrays must be, where the array is declared so: for who does more than keep
            them.
    """
    leaves = list(_leaves(kind))
    checks = [*_of_arrays(leaves, finite_arrays), *_of_fields(leaves, finite_scalars, finite_arrays)]
    return _all_of(checks)


def _all_of(checks: list[Check]) -> Check:
    """Return the check that a body passes all of `checks`: one call, and one for each of them."""
    if len(checks) > _AT_ONCE:
        return _all_of([_all_of(checks[:_AT_ONCE]), *checks[_AT_ONCE:]])
    a, b, c = [*checks, _passes, _passes, _passes][:_AT_ONCE]
    if len(checks) < 2:
        return a
    return (lambda body: a(body) and b(body)) if len(checks) == 2 else lambda body: a(body) and b(body) and c(body)


def _passes(_body: Any) -> bool:
    return True


def _leaves(kind: type[msgspec.Struct], path: str = "") -> Iterator[Leaf]:
    """Yield the fields of `kind` with their dotted names, those of a body that is always there in its place."""
    for field in fields(kind):
        if field.form is FieldForm.ONE and field.body:
            yield from _leaves(field.body, f"{path}{field.name}.")
        else:
            yield path + field.name, field


def _of_fields(leaves: list[Leaf], finite: bool, finite_arrays: bool) -> list[Check]:
    """Return the checks of everything that is not an array."""
    checks = [
        _of_bodies(name, field, check(field.body, finite_scalars=finite, finite_arrays=finite_arrays))
        for name, field in leaves
        if field.body and _holds_something_to_check(field.body, finite)
    ]
    if finite:
        checks += _of_numbers([(name, field) for name, field in leaves if field.item is float])
    return checks


def _holds_something_to_check(kind: type[msgspec.Struct], finite: bool) -> bool:
    """Return whether a body, or one within it, has arrays, or numbers that must be `finite`."""
    kinds = (kind, *nested(kind))
    return any(field.spec is not None or (finite and field.item is float) for each in kinds for field in fields(each))


def _of_bodies(name: str, field: Field, passes: Check) -> Check:
    get = attrgetter(name)
    if field.form is FieldForm.OPTIONAL:
        return lambda body: (value := get(body)) is None or passes(value)
    if field.form is FieldForm.MAP:
        return lambda body: all(map(passes, get(body).values()))
    return lambda body: all(map(passes, get(body)))


def _of_numbers(numbers: list[Leaf]) -> list[Check]:
    """Return the checks that all these numbers are finite: one norm a form."""
    checks: list[Check] = []
    if scalars := _getter(numbers, FieldForm.ONE):
        checks.append(lambda body: isfinite(hypot(*scalars(body))))
    if vectors := _getter(numbers, FieldForm.FIXED, FieldForm.MANY):
        checks.append(lambda body: isfinite(hypot(*chain.from_iterable(vectors(body)))))
    if maps := _getter(numbers, FieldForm.MAP):
        checks.append(lambda body: isfinite(hypot(*chain.from_iterable(m.values() for m in maps(body)))))
    if optional := _getter(numbers, FieldForm.OPTIONAL):
        checks.append(lambda body: isfinite(hypot(*(value for value in optional(body) if value is not None))))
    return checks


def _getter(numbers: list[Leaf], *forms: FieldForm) -> Callable[[Any], tuple[Any, ...]] | None:
    names = [name for name, field in numbers if field.form in forms]
    return _getter_of(names) if names else None


def _getter_of(names: list[str]) -> Callable[[Any], tuple[Any, ...]]:
    return attrgetter(*names, names[0])  # the first twice: attrgetter of one name is no tuple


def _of_arrays(leaves: list[Leaf], finite: bool) -> list[Check]:
    """Return the check that arrays have the declared dtype, agree in shape, have their bytes, and are finite."""
    rows = [(name.rpartition(".")[0], field.spec) for name, field in leaves if field.spec is not None]
    names = [name for name, field in leaves if field.spec is not None]
    if not rows:
        return []
    get, n = _getter_of(names), len(names)
    numbers = [name for name, field in leaves if field.spec is not None and finite and field.spec.must_be_finite]
    get_numbers = _getter_of(numbers) if numbers else None
    good: set[Layout] = set()

    def arrays_agree(body: Any) -> bool:
        found: tuple[Array, ...] = get(body)
        arrays = found[:n]
        layout = tuple(map(_kind, arrays)), tuple(map(len, map(_data, arrays)))
        if layout not in good:
            if not _agrees(layout, rows):
                return False
            if len(good) >= _LAYOUTS:
                good.clear()
            good.add(layout)
        return get_numbers is None or _are_finite(get_numbers(body))

    return [arrays_agree]


def _agrees(layout: Layout, rows: list[tuple[str, Spec]]) -> bool:
    """Return whether arrays are laid out as `rows` say: of each, in which body it is and what that declares."""
    lengths: dict[tuple[str, str], int] = {}
    for (dtype, shape), n_bytes, (where, spec) in zip(*layout, rows, strict=True):
        if dtype != spec.dtype or len(shape) != len(spec.shape):
            return False
        size = int(dtype[2:])
        for length, name in zip(shape, spec.shape, strict=True):
            expected = lengths.setdefault((where, name), length) if isinstance(name, str) else name
            if length != expected or not 0 <= length <= MAX_DIMENSION:
                return False
            size *= length
        if size != n_bytes:
            return False
    return True


def _are_finite(arrays: tuple[Array, ...]) -> bool:
    """Return whether the square of the norm of all `arrays` is finite."""
    numbers = np.frombuffer(b"".join(map(_data, arrays)))
    return isfinite(np.vdot(numbers, numbers))  # unlike dot, it has no warnings to give
