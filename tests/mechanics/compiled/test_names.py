"""Two functions of one name that two processes have compiled stay two in a third, which reads both from disk."""

from __future__ import annotations

import math
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from llvmlite import binding as llvm
from numba import njit

from services.mechanics.compiled import kernel

ROOT = Path(__file__).parents[3]
CALL = """
import sys
from tests.mechanics.compiled import test_names
print(*(getattr(test_names, name)(0.0) for name in sys.argv[1:]))
"""

Sum = Callable[[float], float]


def _sum_from(first: float) -> Sum:
    """Make a sum that begins with a number; it is called twice and long, so it does not become part of its callers."""

    def total(x: float) -> float:
        value = first
        for k in range(int(x)):
            value += math.sin(x + k) * math.cos(x * k)
            if value > 1e9:
                value -= math.sin(x) + math.cos(x + 2.0) + math.exp(x) + math.log(value) + math.atan2(x, value)
            if value > 2e9:
                value -= math.sin(x) - math.cos(x + 3.0) + math.exp(x) - math.log(value) + math.atan2(x, value)
            if value > 3e9:
                value -= math.sin(x) * math.cos(x + 4.0) + math.exp(x) * math.log(value) + math.atan2(x, value)
            if value > 4e9:
                value -= math.sin(x) / math.cos(x + 5.0) + math.exp(x) / math.log(value) + math.atan2(x, value)
        return value

    made: Sum = njit(_nrt=False)(total)
    return made


from_ten, from_hundred = _sum_from(10.0), _sum_from(100.0)


@kernel
def twice_ten(x: float) -> float:
    """Return 20 for a small x."""
    return from_ten(x) + from_ten(x + 0.5)


@kernel
def twice_hundred(x: float) -> float:
    """Return 200 for a small x."""
    return from_hundred(x) + from_hundred(x + 0.5)


def _call(names: list[str], kernels: Path) -> list[float]:
    """Return what kernels of this file say in another process."""
    done = subprocess.run(
        [sys.executable, "-c", CALL, *names],
        env={**os.environ, "NUMBA_CACHE_DIR": str(kernels)},
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return [float(word) for word in done.stdout.split()]


def _symbols(kernels: Path, name: str) -> set[str]:
    """Return the names of what is compiled in the code of a kernel, as callers link it."""
    (file,) = kernels.glob(f"*/test_names.{name}-*.nbc")
    (_, _, (_, for_callers)), *_ = pickle.loads(file.read_bytes())
    return {each.name for each in llvm.parse_bitcode(for_callers).functions if not each.is_declaration}


def test_what_two_processes_compiled_under_one_name_is_called_by_its_own_callers(tmp_path: Path) -> None:
    """Each of the two does just as much before it comes to its sum: it was the same number to both."""
    assert _call(["twice_ten"], tmp_path) == [20.0]
    assert _call(["twice_hundred"], tmp_path) == [200.0]
    one, other = _symbols(tmp_path, "twice_ten"), _symbols(tmp_path, "twice_hundred")
    assert any("total" in name for name in one), "the sum has become part of its caller: nothing is shown"
    assert not one & other
    assert _call(["twice_ten", "twice_hundred"], tmp_path) == [20.0, 200.0]
