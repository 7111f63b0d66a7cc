"""Kernels are counted as they are compiled, and how far it is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from trocar.services.mechanics.compiled import KERNELS, kernel
from trocar.services.start import kernel_progress


def test_what_is_compiled_is_counted_once_a_kernel(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # A folder of its own: what an earlier run of the tests has compiled would be loaded, and nothing counted.
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(kernel_progress, "_APART_S", 0.001)
    known = len(KERNELS)

    @kernel
    def twice(x: float) -> float:
        return 2.0 * x

    @kernel
    def four_times(x: float) -> float:
        return twice(twice(x))

    @kernel
    def not_used(x: float) -> float:
        return x

    said: list[tuple[str, float]] = []
    with kernel_progress.told(lambda text, fraction: said.append((text, fraction)), expected=4) as kernels:
        kernels.begin("sums")
        assert four_times(1.0) == 4.0
        assert four_times(1) == 4, "another signature of the same kernels"
    not_used(1.0)
    texts = [text for text, _ in said]
    assert "sums: 0 kernels compiled" in texts
    assert ("sums: 2 kernels compiled", 0.5) in said
    assert said[-1] == ("2 kernels compiled", 1.0), "its bar ends at its end, whatever was expected"
    assert len(said) > 3, "told while they are compiled, too"
    assert [fraction for _, fraction in said] == sorted(fraction for _, fraction in said)
    del KERNELS[known:]


def test_more_kernels_than_expected_never_pass_the_end() -> None:
    told = [kernel_progress.approach(0.01 * k) for k in range(500)]
    assert told == sorted(told)
    assert told[50] == 0.5
    assert told[95] < told[120] < 1.0
    assert max(told) <= 1.0
