"""Items and rows of arrays are where numpy has them, whatever the index, and take few instructions."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit

from services.mechanics.compiled import kernel

INDICES = [-3, -1, 0, 2]
KINDS = [np.int64, np.int32, np.uint8]


@kernel
def item(array: Any, i: int, j: int, k: int) -> float:
    """Return an item by one tuple, and by rows."""
    row = array[i, j]
    plane = array[i]
    if array[i, j, k] != row[k] or row[k] != plane[j, k] or plane.size != array.size // array.shape[0]:
        return np.nan
    return array[i, j, k] + 0.0


@kernel
def of_row(row: Any, i: int) -> float:
    """Return an item of a row that another kernel is handed, by its strides and extents."""
    total = 0.0
    for k in range(row.shape[0]):
        total += k * row[k]
    return total + 1000.0 * row[i] + row.strides[0]


@kernel
def handed_on(array: Any, i: int, j: int, k: int) -> float:
    """Hand on a row."""
    return of_row(array[i, j], k)


@kernel
def put(array: Any, i: int, j: int, k: int, value: float) -> None:
    """Write an item."""
    array[i, j, k] = value


@kernel
def put_known(array: Any) -> None:
    """Write where the index is written in the source, from the end too, and a row."""
    array[0, 1] = 1
    array[-1, -2] = array[0, 1] + 1
    array[1] = 7


@kernel
def one_place(array: Any, i: int, j: int) -> float:
    """Return one item."""
    return array[i, j]


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int32, np.int8, np.bool_])
@pytest.mark.parametrize("order", "CFA")
def test_an_item_is_where_numpy_has_it(dtype: type, order: str) -> None:
    whole = (np.arange(3 * 4 * 5) % 7).reshape(3, 4, 5).astype(dtype)
    array = whole[:, ::2] if order == "A" else whole.copy(order=order)
    for i, j, k in itertools.product([-3, -1, 0, 2], [-2, -1, 0, 1], [-5, -1, 0, 4]):
        assert item(array, i, j, k) == array[i, j, k]


@pytest.mark.parametrize("kind", KINDS)
def test_an_index_of_any_integer_counts_from_the_end_where_it_is_negative(kind: type) -> None:
    array = np.arange(12.0).reshape(3, 4)
    for i in INDICES:
        if kind is not np.uint8 or i >= 0:
            assert one_place(array, kind(i), kind(i)) == array[i, i]


def test_a_row_that_is_handed_on_has_its_own_extents() -> None:
    array = np.arange(60.0).reshape(3, 4, 5)
    for i, j, k in itertools.product(INDICES, INDICES, INDICES):
        expected = np.arange(5) @ array[i, j] + 1000.0 * array[i, j, k] + array[i, j].strides[0]
        assert handed_on(array, i, j, k) == expected


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int32, np.int8, np.bool_])
def test_an_item_is_written_where_numpy_has_it(dtype: type) -> None:
    for place in itertools.product(INDICES, INDICES, INDICES):
        array = np.zeros((3, 4, 5), dtype)
        put(array, *place, 1.0)
        assert array[place] == 1
        assert np.count_nonzero(array) == 1


def test_places_that_the_source_names_are_written() -> None:
    array = np.zeros((3, 4))
    put_known(array)
    assert array.tolist() == [[0, 1, 0, 0], [7, 7, 7, 7], [0, 0, 2, 0]]


def test_functions_that_count_references_keep_what_a_row_is_of() -> None:
    @njit
    def row_of_new(n: int) -> Any:
        return np.arange(3.0 * n).reshape(3, n)[1]

    assert row_of_new(4).tolist() == [4, 5, 6, 7]


def test_one_item_takes_few_instructions(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Fails with a numba that looks elsewhere: then a cold start takes longer, and nothing else is wrong."""
    from numba.core import codegen

    lengths: list[int] = []
    add = codegen.CPUCodeLibrary.add_ir_module

    def counting(library: Any, module: Any) -> None:
        lengths.append(sum(len(block.instructions) for function in module.functions for block in function.blocks))
        add(library, module)

    monkeypatch.setattr(codegen.CPUCodeLibrary, "add_ir_module", counting)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))  # what an earlier run has stored would not be lowered again

    @kernel
    def of_two(array: Any, i: int, j: int) -> float:
        return array[i, j]

    assert of_two(np.eye(2), 1, -1) == 1.0
    assert lengths[0] < 60
