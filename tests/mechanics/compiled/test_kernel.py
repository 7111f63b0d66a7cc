from typing import NamedTuple

import numpy as np
import pytest

from services.mechanics.arrays import BoolArray, FloatArray, IntArray
from services.mechanics.compiled import Placed, kernel, tuple_reader


class Inner(NamedTuple):
    flags: BoolArray
    factor: float


class Outer(NamedTuple):
    values: FloatArray
    inner: Inner
    nodes: IntArray


def example():
    values = np.arange(24.0).reshape(2, 3, 4)
    return Outer(values, Inner(np.array([True, False]), 0.5), np.array([[1, 2], [3, 4]], np.int32))


outer_at = tuple_reader(example())


@kernel
def read_and_write(address: int) -> float:
    outer = outer_at(address)
    outer.values[1, 2, 3] += 1.0
    outer.inner.flags[1] = True
    return outer.inner.factor * outer.values[1, 0, 2] + outer.nodes[1, 0] * outer.values.shape[2]


def test_a_kernel_finds_a_nested_tuple_at_its_address():
    placed = Placed(example())
    assert read_and_write(placed.address) == 0.5 * 14.0 + 3 * 4
    assert placed.arrays.values[1, 2, 3] == 24.0
    assert placed.arrays.inner.flags.all()


def test_an_array_with_gaps_is_refused():
    with pytest.raises(ValueError, match="not C-contiguous"):
        Placed(example()._replace(values=np.zeros((2, 3, 8))[:, :, ::2]))
