"""Kernels are counted as they are compiled, and it is told of how many at most."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from services.kernel_progress import told
from services.mechanics.compiled import kernel


def _kernels() -> dict[str, Any]:
    """Return kernels made now: where they are kept is asked when they are made."""

    @kernel
    def twice(x: float) -> float:
        return 2.0 * x

    @kernel
    def four_times(x: float) -> float:
        return twice(twice(x))

    @kernel
    def not_used(x: float) -> float:
        return x

    return {"twice": twice, "four_times": four_times, "not_used": not_used}


def test_what_is_compiled_is_counted_once_a_kernel(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # A folder of its own: what an earlier run of the tests has compiled would be loaded, and nothing counted.
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    kernels_of_test = _kernels()
    module = ModuleType("services.of_a_test")
    vars(module).update(kernels_of_test)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr("services.kernel_progress._APART_S", 0.0)
    monkeypatch.setattr("sys.modules", {module.__name__: module})
    said: list[tuple[str, float]] = []
    with told(lambda text, fraction: said.append((text, fraction))) as kernels:
        monkeypatch.undo()
        monkeypatch.setattr("services.kernel_progress._APART_S", 0.0)
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
        kernels.begin("sums")
        assert kernels_of_test["four_times"](1.0) == 4.0
        assert kernels_of_test["four_times"](1) == 4, "another signature of the same kernels"
    kernels_of_test["not_used"](1.0)
    texts = [text for text, _ in said]
    assert texts[0] == "sums: 0 kernels compiled, of at most 3"
    assert texts[-1] == "sums: 2 kernels compiled, of at most 3"
    assert said[-1][1] == pytest.approx(2 / 3)
    assert [fraction for _, fraction in said] == sorted(fraction for _, fraction in said)
