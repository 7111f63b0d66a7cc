"""Of the passes over a kernel those are left out that would find nothing in it, and no others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core import event
from numba.core.errors import TypingError

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import kernel


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nothing be found that was compiled before."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))


def _passes_told(call: Any, *arguments: Any) -> list[str]:
    with event.install_recorder("numba:run_pass") as recorder:
        call(*arguments)
    return [each.data["name"] for _, each in recorder.buffer]


def test_a_kernel_with_a_closure_is_compiled_with_it() -> None:
    @kernel
    def with_closure(x: float, n: int) -> float:
        def grown(y: float) -> float:
            return y + n

        return grown(x) * grown(2.0 * x)

    assert with_closure(3.0, 2) == 40.0


def test_nobody_is_told_of_the_passes_over_a_kernel() -> None:
    @kernel
    def plain(x: float) -> float:
        return x + 1.0

    assert _passes_told(plain, 1.0) == []


def test_an_array_that_is_computed_whole_is_refused_still() -> None:
    @kernel
    def whole(a: FloatArray, b: FloatArray) -> None:
        a[:] = 2.0 * a + b

    with pytest.raises(Exception, match=r"(?i)nrt|allocat|runtime"):
        whole(np.ones(3), np.ones(3))


def test_what_cannot_be_typed_names_the_pass() -> None:
    @kernel
    def wrong(x: float) -> float:
        return x.no_such_part  # type: ignore[attr-defined,no-any-return]

    with pytest.raises(TypingError, match=r"nopython frontend[\s\S]*no_such_part"):
        wrong(1.0)
