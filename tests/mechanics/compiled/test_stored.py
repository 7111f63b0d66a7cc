"""A process that finds its kernels on disk has nothing made ready for compiling any, and they do the same."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from services.mechanics.arrays import FloatArray
from services.mechanics.compiled import building_kernel, kernel

_RUN = """
import numpy as np
from numba.core.cpu import CPUContext
refresh, asked = CPUContext.refresh, []
CPUContext.refresh = lambda self: (asked.append(1), refresh(self))[1]
from {module} import halves, halved
values = np.arange(5.0)
halved(values)
print(values.sum(), halves(values).sum(), bool(asked), sum(map(len, (halved.overloads, halves.overloads))))
"""


@kernel
def _half(x: float) -> float:
    return 0.5 * x


@kernel
def halved(values: FloatArray) -> None:
    for k in range(values.shape[0]):
        values[k] = _half(values[k])


@building_kernel
def halves(values: FloatArray) -> FloatArray:
    """Allocates, and lets go of it again."""
    made = np.empty(values.shape[0])
    for k in range(values.shape[0]):
        made[k] = 0.5 * values[k]
    return 1.0 * made


def _run(cache: Path) -> list[str]:
    here = Path(__file__)
    paths = os.pathsep.join((str(here.parent), str(here.parents[3])))
    done = subprocess.run(
        [sys.executable, "-c", _RUN.format(module=here.stem)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": paths},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.timeout(300)
def test_what_is_stored_is_read_without_what_compiles(tmp_path: Path) -> None:
    assert _run(tmp_path) == ["5.0", "2.5", "True", "2"], "from nothing, to see that it is asked for at all"
    assert _run(tmp_path) == ["5.0", "2.5", "False", "2"]
