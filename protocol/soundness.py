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
from typing import Any, get_args, get_origin

import msgspec
import numpy as np

from protocol.arrays import MAX_DIMENSION, Array
from protocol.declared import array_specs, other_fields

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
    scalars: list[str] = []
    vectors: list[str] = []
    checks: list[Check | None] = []
    for name, hint in other_fields(kind):
        inner = get_args(hint)
        if hint is float:
            scalars.append(name)
        elif get_origin(hint) is tuple and inner[-1] is float:
            vectors.append(name)
        elif isinstance(hint, type) and issubclass(hint, msgspec.Struct):
            checks.append(_of_struct(name, check(hint, finite_scalars=finite)))
        elif get_origin(hint) is tuple and issubclass(inner[0], msgspec.Struct):
            checks.append(_of_each(name, check(inner[0], finite_scalars=finite)))
        else:
            checks.append(_of_optional(name, hint, finite))
    if finite:
        checks += _of_numbers(scalars, vectors)
    return [each for each in checks if each is not None]


def _of_numbers(scalars: list[str], vectors: list[str]) -> list[Check]:
    checks: list[Check] = []
    if scalars:
        numbers = attrgetter(*scalars, scalars[0])  # the first twice: attrgetter of one name is no tuple
        checks.append(lambda body: isfinite(sum(numbers(body))))
    if vectors:
        tuples = attrgetter(*vectors, vectors[0])
        checks.append(lambda body: isfinite(sum(map(sum, tuples(body)))))
    return checks


def _of_struct(name: str, passes: Check) -> Check:
    get = attrgetter(name)
    return lambda body: passes(get(body))


def _of_each(name: str, passes: Check) -> Check:
    get = attrgetter(name)
    return lambda body: all(map(passes, get(body)))


def _of_optional(name: str, hint: Any, finite: bool) -> Check | None:
    """Return the check of ``Struct | None``; None where nothing needs one, e.g. a dict of counts."""
    inner = get_args(hint)
    if len(inner) != 2 or inner[1] is not type(None):
        return None
    get, passes = attrgetter(name), check(inner[0], finite_scalars=finite)
    return lambda body: (value := get(body)) is None or passes(value)


def _of_arrays(kind: type[msgspec.Struct]) -> list[Check]:
    """Return the check that arrays have the declared dtype, agree in shape, have their bytes, and are finite."""
    rows = [
        (attrgetter(name), spec.dtype, spec.shape, len(spec.shape), int(spec.dtype[2:]), spec.must_be_finite)
        for name, spec in array_specs(kind)
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
