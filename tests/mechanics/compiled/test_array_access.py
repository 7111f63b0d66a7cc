"""An item of an array is what Python finds there, whatever the dtype and the index, and however it is written."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from services.mechanics.compiled import kernel

Array = npt.NDArray[Any]


@kernel
def _exchange(line: Array, plane: Array, cube: Array, i: int, j: int) -> tuple[float, ...]:
    line[i], line[-1] = line[-1], line[j]
    plane[i, 0] = plane[-1, j]
    plane[j, -1] = plane[0, i] + plane[1, j]
    cube[i, j, -2] = line[0]
    cube[-1, i, j] = cube[0, -1, i]
    row = plane[j]
    return line[j], plane[i, j], plane[0, -1], cube[j, i, 1], cube[-1, -1, -1], row[i]


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int64, np.int32, np.bool_])
@pytest.mark.parametrize(("i", "j"), [(0, 1), (-1, -2), (np.int32(1), 0), (np.uint8(1), np.uint64(0))])
def test_items_are_read_and_written_as_by_python(dtype: type, i: int, j: int) -> None:
    shapes = (3,), (3, 4), (2, 3, 4)
    ours = [np.arange(np.prod(shape)).reshape(shape).astype(dtype) for shape in shapes]
    pythons = [each.copy() for each in ours]
    given = _exchange(*ours, i, j)
    assert given == _exchange.py_func(*pythons, i, j)  # type: ignore[attr-defined]
    for a, b in zip(ours, pythons, strict=True):
        np.testing.assert_array_equal(a, b)
