"""What kernels call is compiled once for all integers and constants."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trocar.services.mechanics.arrays import IntArray
from trocar.services.mechanics.compiled import KERNELS, kernel


def test_what_kernels_call_is_compiled_once_for_sizes_and_constants(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))  # what is found on disk calls nothing that is compiled
    known = len(KERNELS)

    @kernel
    def scaled(n: int, factor: int, is_negative: bool) -> int:
        return -n * factor if is_negative else n * factor

    @kernel
    def many(values: IntArray) -> int:
        a, b = scaled(3, 2, True), scaled(values[0], 5, False)
        return int(a + b + scaled(values.shape[0], values[1], values[0] > 0))

    assert many(np.array([7, 4], np.int32)) == -6 + 35 - 8
    called, _ = KERNELS[known:]
    del KERNELS[known:]
    assert [str(each) for each in called.signatures] == ["(int64, int64, bool)"]
