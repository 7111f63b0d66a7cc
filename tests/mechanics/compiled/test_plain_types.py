"""What kernels call is compiled once for all integers and constants that it is called with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import types
from numba.core import event

from services.mechanics.arrays import ByteArray, FloatArray, IntArray, LongArray
from services.mechanics.compiled import kernel
from services.mechanics.compiled.plain_types import plain

Place = tuple[int, int]


def _compiled(function: Any, *arguments: Any) -> tuple[Any, list[str]]:
    """Return what a kernel returns, and for what which kernels were compiled meanwhile."""
    with event.install_recorder("numba:compile") as recorder:
        value = function(*arguments)
    started = [each.data for _, each in recorder.buffer if each.is_start]
    return value, [f"{each['dispatcher'].py_func.__name__}{each['args']}" for each in started]


def _caller() -> Any:
    """Return a kernel that calls another in many ways."""

    def item(array: FloatArray, place: Place, down: bool) -> float:
        return array[place[0], place[1]] * (-1.0 if down else 1.0)

    called = kernel(item)

    def caller(array: FloatArray, small: ByteArray, middle: IntArray, large: LongArray) -> float:
        total = called(array, (1, 2), False)
        for k in range(small.shape[0]):
            total += 10.0 * called(array, (small[k], middle[k]), True)
            total += 100.0 * called(array, (large[k], 1), small[k] > middle[k])
            total += 1000.0 * called(array, (large[k], middle[k]), down=False)
        return total

    return kernel(caller)


def test_integers_of_all_sizes_and_constants_are_one_kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))  # where nothing is found that was compiled before
    array = np.arange(12.0).reshape(3, 4)
    caller = _caller()
    given = np.array([2], np.int8), np.array([-1], np.int32), np.array([1])
    value, compiled = _compiled(caller, array, *given)
    assert value == 6.0 - 110.0 - 500.0 + 7000.0
    assert len([each for each in compiled if each.startswith("item")]) == 1, compiled
    assert len(compiled) == 2


def test_a_negative_integer_of_a_smaller_size_keeps_its_sign() -> None:
    def same(x: int) -> int:
        return x

    called = kernel(same)

    def caller(small: ByteArray, middle: IntArray) -> int:
        return called(small[0]) * 1000 + called(middle[0])

    assert kernel(caller)(np.array([-128], np.int8), np.array([-(2**31)], np.int32)) == -128_000 - 2**31


def test_plain_types_of_arguments() -> None:
    constant, truth = types.literal(3), types.literal(True)
    assert plain(constant) is types.int64
    assert plain(truth) is types.boolean
    assert plain(types.int8) is plain(types.uint32) is types.int64
    assert plain(types.uint64) is types.uint64
    assert plain(types.float32) is types.float32
    nested = types.Tuple([types.int32, types.Tuple([constant, types.float64]), truth])
    assert plain(nested) == types.Tuple([types.int64, types.Tuple([types.int64, types.float64]), types.boolean])
    assert plain(types.Tuple([types.int8, constant])) == types.UniTuple(types.int64, 2)
    array = types.Array(types.int32, 1, "C")
    assert plain(array) is array, "arrays are handed on as they are"
