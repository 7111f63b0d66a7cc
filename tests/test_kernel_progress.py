"""Kernels are counted as they are compiled, and it is told of how many at most."""

from __future__ import annotations

import sys
from types import ModuleType

import pytest

from services.kernel_progress import told
from services.mechanics.compiled import kernel


@kernel
def _twice(x: float) -> float:
    return 2.0 * x


@kernel
def _four_times(x: float) -> float:
    return _twice(_twice(x))


@kernel
def _not_used(x: float) -> float:
    return x


def test_what_is_compiled_is_counted_once_a_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("services.of_a_test")
    for each in (_twice, _four_times, _not_used):
        setattr(module, each.__name__, each)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr("services.kernel_progress._APART_S", 0.0)
    monkeypatch.setattr("sys.modules", {module.__name__: module})
    said: list[tuple[str, float]] = []
    with told(lambda text, fraction: said.append((text, fraction))) as kernels:
        monkeypatch.undo()
        monkeypatch.setattr("services.kernel_progress._APART_S", 0.0)
        kernels.begin("sums")
        assert _four_times(1.0) == 4.0
        assert _four_times(1) == 4, "another signature of the same kernels"
    _not_used(1.0)
    texts = [text for text, _ in said]
    assert texts[0] == "sums: 0 kernels compiled, of at most 3"
    assert texts[-1] == "sums: 2 kernels compiled, of at most 3"
    assert said[-1][1] == pytest.approx(2 / 3)
    assert [fraction for _, fraction in said] == sorted(fraction for _, fraction in said)
