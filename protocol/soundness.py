"""Whether a decoded body is what it declares: the check that every frame passes, made once per body type.

`declared.fault` walks a body and names what is wrong with it; that takes longer than decoding. Here the walk is done
once, over the type, and what is left for each frame are a few additions: a sum is finite only if every term is. A body
that does not pass may still be faultless (finite terms can add up to infinity): `declared.fault` has the last word.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import isfinite
from operator import attrgetter
from typing import Any

import msgspec
import numpy as np

from protocol.arrays import MAX_DIMENSION, Array
from protocol.fields import Field, Form, arrays, fields

Check = Callable[[Any], bool]

#: Below this, Python adds up the numbers of an array faster than numpy.
_SHORT_BYTES = 64 * 8


@cache
def check(kind: type[msgspec.Struct], *, finite_scalars: bool) -> Check:
    """Return the check of bodies of `kind`.

    Parameters
    ----------
    kind
        A body type, or one that bodies hold.
    finite_scalars
        Whether numbers outside arrays must be finite: so for commands.
    """
    checks = [*_of_arrays(kind), *_of_fields(kind, finite_scalars)]
    if len(checks) == 1:
        return checks[0]
    return lambda body: all(passes(body) for passes in checks)


def _of_fields(kind: type[msgspec.Struct], finite: bool) -> list[Check]:
    """Return the checks of everything in `kind` that is not an array."""
    checks = [_of_bodies(field, check(field.body, finite_scalars=finite)) for field in fields(kind) if field.body]
    if finite:
        checks += _of_numbers([field for field in fields(kind) if field.item is float])
    return checks


def _of_bodies(field: Field, passes: Check) -> Check:
    get = attrgetter(field.name)
    if field.form is Form.ONE:
        return lambda body: passes(get(body))
    if field.form is Form.OPTIONAL:
        return lambda body: (value := get(body)) is None or passes(value)
    if field.form is Form.MAP:
        return lambda body: all(map(passes, get(body).values()))
    return lambda body: all(map(passes, get(body)))


def _of_numbers(numbers: list[Field]) -> list[Check]:
    """Return the checks that all these numbers are finite: one sum a form."""
    checks: list[Check] = []
    if scalars := _getter(numbers, Form.ONE):
        checks.append(lambda body: isfinite(sum(scalars(body))))
    if vectors := _getter(numbers, Form.FIXED, Form.MANY):
        checks.append(lambda body: isfinite(sum(map(sum, vectors(body)))))
    if maps := _getter(numbers, Form.MAP):
        checks.append(lambda body: isfinite(sum(sum(values.values()) for values in maps(body))))
    if optional := _getter(numbers, Form.OPTIONAL):
        checks.append(lambda body: isfinite(sum(value for value in optional(body) if value is not None)))
    return checks


def _getter(numbers: list[Field], *forms: Form) -> Callable[[Any], tuple[Any, ...]] | None:
    names = [field.name for field in numbers if field.form in forms]
    return attrgetter(*names, names[0]) if names else None  # the first twice: attrgetter of one name is no tuple


def _of_arrays(kind: type[msgspec.Struct]) -> list[Check]:
    """Return the check that arrays have the declared dtype, agree in shape, have their bytes, and are finite."""
    rows = [
        (attrgetter(name), spec.dtype, spec.shape, len(spec.shape), int(spec.dtype[2:]), spec.must_be_finite)
        for name, spec in arrays(kind)
    ]

    def arrays_agree(body: Any) -> bool:
        lengths: dict[str, int] = {}
        for get, dtype, declared, n_dimensions, size, finite in rows:
            array: Array = get(body)
            shape = array.shape
            if array.dtype != dtype or len(shape) != n_dimensions:
                return False
            for length, name in zip(shape, declared, strict=True):
                expected = lengths.setdefault(name, length) if name.__class__ is str else name
                if length != expected or not 0 <= length <= MAX_DIMENSION:
                    return False
                size *= length
            if size != len(array.data) or (finite and not _is_finite(array.data)):
                return False
        return True

    return [arrays_agree] if rows else []


def _is_finite(data: bytes) -> bool:
    if len(data) <= _SHORT_BYTES:
        return isfinite(sum(memoryview(data).cast("d")))
    return isfinite(np.frombuffer(data).sum())
