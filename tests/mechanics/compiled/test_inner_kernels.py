"""What kernels call is compiled once for all integers and constants, and never takes the place of what Python calls."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from services.mechanics.arrays import IntArray
from services.mechanics.compiled import KERNELS, kernel

#: Asked in processes of their own, of which each reads what those before it have stored.
_ASK = "from tests.mechanics.compiled.test_inner_kernels import {0} as f; print(f(1), f.stats.cache_hits.total())"


@kernel
def _next(n: int) -> int:
    return n + 1


@kernel
def _next_but_one(n: int) -> int:
    return int(_next(_next(n)))


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
    python, _, copy = KERNELS[known:]
    del KERNELS[known:]
    assert not python.signatures, "Python has not called it"
    assert [str(each) for each in copy.signatures] == ["(int64, int64, bool)"]


def test_either_is_found_on_disk_as_what_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    # The copy for kernels is stored first: Python would jump to an entry that it does not have.
    assert [_ask(name) for name in ("_next_but_one", "_next") * 2] == ["3 0", "2 0", "3 1", "2 1"]


def _ask(name: str) -> str:
    command = [sys.executable, "-c", _ASK.format(name)]
    return subprocess.run(
        command, check=True, capture_output=True, text=True, cwd=Path(__file__).parents[3]
    ).stdout.strip()
