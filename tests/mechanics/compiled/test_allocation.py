"""No kernel of a tick allocates: its machine code, as it is kept on disk, does not name numba's allocator."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.compiled import KERNELS, kernel

_ALLOCATOR = b"NRT_MemInfo_alloc"


def allocating(kernels: Iterable[Any]) -> list[str]:
    """Return the names of kernels that allocate, with all that they call, of those that are compiled."""
    return [
        each.py_func.__qualname__
        for each in kernels
        if each.signatures and any(_ALLOCATOR in path.read_bytes() for path in _stored(each))
    ]


def _stored(kernel: Any) -> list[Path]:
    """Return the files of a kernel's signatures."""
    function = kernel.py_func
    name = function.__qualname__.replace("<locals>", "*")
    found = [*Path(kernel.stats.cache_path).glob(f"*{name}-{function.__code__.co_firstlineno}.*.nbc")]
    assert found, f"{function.__qualname__}: compiled, and not kept on disk"
    return found


def test_a_hidden_copy_is_found_and_a_view_is_none(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    known = len(KERNELS)

    @kernel
    def copies(rows: FloatArray) -> None:
        rows[0] = rows[1].copy()

    @kernel
    def views(rows: FloatArray) -> float:
        row: float = rows[1][0]
        return row

    @kernel
    def calls(rows: FloatArray) -> None:
        copies(rows)

    of_test = KERNELS[known:]
    calls(np.zeros((2, 3)))
    views(np.zeros((2, 3)))
    del KERNELS[known:]
    assert [name.rpartition(".")[2] for name in allocating(of_test)] == ["copies", "calls"]
