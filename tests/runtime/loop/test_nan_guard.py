"""The guard keeps what came before a NaN."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trocar.services.runtime.loop.nan_guard import NanGuard


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_the_moments_before_are_written(tmp_path: Path, bad: float) -> None:
    q = np.zeros(3)
    guard = NanGuard("physics", {"q": q}, tmp_path, depth=5)
    for step in range(12):
        q[:] = step
        assert guard.watch()
    q[1] = bad
    assert not guard.watch()
    with np.load(guard.dumps[0]) as dump:
        np.testing.assert_array_equal(dump["q"][:, 0], [8, 9, 10, 11, 11])
        assert not np.isfinite(dump["q"][-1, 1])


def test_no_file_while_all_is_well(tmp_path: Path) -> None:
    guard = NanGuard("physics", {"q": np.ones(3)}, tmp_path / "dumps")
    assert guard.watch()
    assert not (tmp_path / "dumps").exists()
