"""Loops over ranges count as Python's."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from services.mechanics.arrays import LongArray
from services.mechanics.compiled import kernel


@kernel
def count_to(stop: int, out: LongArray) -> int:
    """Write the numbers; return how many there are."""
    n = 0
    for k in range(stop):
        out[n] = k
        n += 1
    return n


@kernel
def count_from_to(start: int, stop: int, out: LongArray) -> int:
    """Write the numbers; return how many there are."""
    n = 0
    for k in range(start, stop):
        out[n] = k
        n += 1
    return n


@kernel
def count_in_steps(start: int, stop: int, step: int, out: LongArray) -> int:
    """Write the numbers; return how many there are."""
    n = 0
    for k in range(start, stop, step):
        out[n] = k
        n += 1
    return n


@kernel
def count_in_threes(start: int, stop: int, out: LongArray) -> int:
    """Write the numbers; return how many there are."""
    n = 0
    for k in range(start, stop, 3):
        out[n] = k
        n += 1
    return n


@kernel
def count_down(start: int, stop: int, out: LongArray) -> int:
    """Write the numbers; return how many there are."""
    n = 0
    for k in range(start, stop, -1):
        out[n] = k
        n += 1
    return n


@kernel
def last_of_nested(n: int) -> int:
    """Return what variables of loops hold when those have ended, one early."""
    i = j = -1
    for i in range(n):
        for j in range(i, 10, 2):
            if j > 6:
                break
    return 100 * i + j


@kernel
def choose(which: bool, n: int) -> int:
    """Return the sum of one of two ranges, of which neither is known where the loop begins."""
    numbers = range(n) if which else range(n, 0, -2)
    total = 0
    for k in numbers:
        total = 10 * total + k
    return total


LIMITS = range(-4, 5)


def _written(count: object, *limits: int) -> list[int]:
    out = np.zeros(20, np.int64)
    return out[: count(*limits, out)].tolist()


def test_a_loop_counts_as_pythons() -> None:
    for start, stop in itertools.product(LIMITS, LIMITS):
        assert _written(count_to, stop) == list(range(stop))
        assert _written(count_from_to, start, stop) == list(range(start, stop))
        assert _written(count_in_threes, start, stop) == list(range(start, stop, 3))
        assert _written(count_down, start, stop) == list(range(start, stop, -1))
        for step in (-3, -2, -1, 1, 2, 3):
            assert _written(count_in_steps, start, stop, step) == list(range(start, stop, step))


def test_a_step_of_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="must not be zero"):
        _written(count_in_steps, 0, 1, 0)


def test_variables_keep_what_they_had_last() -> None:
    python = last_of_nested.py_func
    assert [last_of_nested(n) for n in range(12)] == [python(n) for n in range(12)]


def test_one_of_two_ranges() -> None:
    python = choose.py_func
    for which, n in itertools.product([True, False], range(6)):
        assert choose(which, n) == python(which, n)
