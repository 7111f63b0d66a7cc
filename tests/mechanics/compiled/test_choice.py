"""A kernel chosen by a number is called in place: nothing is compiled for the choice."""

from __future__ import annotations

import numpy as np
import pytest

from services.mechanics.arrays import ByteArray, FloatArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.choice import one_of


@kernel
def first(out: FloatArray, x: float) -> float:
    """Write and return x."""
    out[0] = x
    return x


@kernel
def second(out: FloatArray, x: float) -> int:
    """Return an integer where the others return a float."""
    out[1] = x
    return 2


@kernel
def third(out: FloatArray, x: float) -> float:
    """Refuse what is negative."""
    if x < 0.0:
        raise ValueError("below zero")
    out[2] = x
    return -x


any_of = one_of([first, second, third])


@kernel
def call(numbers: ByteArray, k: int, out: FloatArray, x: float) -> float:
    """Call the one whose number is in an array."""
    return any_of(numbers[k], out, x)


@kernel
def call_constant(out: FloatArray, x: float) -> float:
    """Call one that is known when this is compiled."""
    return any_of(1, out, x)


@kernel
def call_all(n: int, out: FloatArray) -> float:
    """Call each, several times."""
    total = 0.0
    for k in range(n):
        total += any_of(k % 3, out, float(k))
    return total


@pytest.mark.parametrize(
    ("number", "value", "place"), [(0, 4.0, 0), (1, 2.0, 1), (2, -4.0, 2), (7, -4.0, 2), (-1, -4.0, 2)]
)
def test_the_number_chooses_and_one_that_none_has_means_the_last(number: int, value: float, place: int) -> None:
    out = np.zeros(3)
    assert call(np.array([9, number], np.int8), 1, out, 4.0) == value
    assert list(np.flatnonzero(out)) == [place]


def test_what_is_known_before_and_what_changes() -> None:
    out = np.zeros(3)
    assert call_constant(out, 4.0) == 2.0
    assert call_all(6, out) == 0.0 + 2.0 - 2.0 + 3.0 + 2.0 - 5.0
    assert list(out) == [3.0, 4.0, 5.0]


def test_an_error_in_one_is_an_error_of_the_caller() -> None:
    with pytest.raises(ValueError, match="below zero"):
        call(np.array([2], np.int8), 0, np.zeros(3), -1.0)
