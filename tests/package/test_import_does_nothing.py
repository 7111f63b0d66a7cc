"""A program that imports Trocar stays as it was: environment, threads, signals, collector, settings, import hooks."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

_PROGRAM = """
import gc, json, os, signal, sys, threading, warnings
import gymnasium, numba, numpy, scipy.linalg, scipy.sparse.linalg, scipy.spatial, scipy.special, threadpoolctl

def state():
    return {
        "environment": dict(os.environ),
        "threads": threading.active_count(),
        "pools": [(pool["prefix"], pool["num_threads"]) for pool in threadpoolctl.threadpool_info()],
        "signals": {str(number): repr(signal.getsignal(number)) for number in signal.valid_signals()},
        "collector": (gc.isenabled(), gc.get_threshold(), gc.get_freeze_count()),
        "numba": {name: repr(getattr(numba.config, name)) for name in dir(numba.config) if name.isupper()},
        "hooks": (len(sys.path_hooks), len(sys.meta_path), sys.dont_write_bytecode, sys.pycache_prefix),
        "path": list(sys.path),
        "errors": (repr(sys.excepthook), numpy.geterr(), len(warnings.filters)),
    }

before, told = state(), []
for use in sys.argv[1:]:
    exec(use, {})
    after = state()
    told.append([{name: [before[name], after[name]] for name in before if before[name] != after[name]}, [*sys.modules]])
print(json.dumps(told))
"""
_IMPORT = "import trocar"
Told = dict[str, tuple[dict[str, object], set[str]]]
_SMALL = Path(__file__).parents[1] / "scenes" / "small.yaml"
_USES = [
    "import trocar; trocar.Simulation",
    "from trocar import *",
    "import trocar.envs",
    f"import trocar; trocar.simulate(trocar.load_scene({str(_SMALL)!r})).step(trocar.Hands())",
]


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Told:
    """Return what one program is told after each use in turn: what differs from its beginning, and its modules."""
    # Threads as a stranger's program has them; kernels and bases are those of the other tests.
    left_out = {"OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"}
    environment = {name: value for name, value in os.environ.items() if name not in left_out}
    environment |= {"PYTHONPATH": str(Path(__file__).parents[2]), "OPENBLAS_NUM_THREADS": "2"}
    folder, uses = tmp_path_factory.mktemp("program"), [_IMPORT, *_USES]
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM, *uses], capture_output=True, text=True, cwd=folder, env=environment
    )
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout.splitlines()[-1])
    return {use: (changes, set(modules)) for use, (changes, modules) in zip(uses, said, strict=True)}


def test_the_import_changes_nothing_and_brings_no_library(told: Told) -> None:
    changes, modules = told[_IMPORT]
    assert changes == {}
    assert not {name for name in modules if name.startswith("trocar.")}


@pytest.mark.parametrize("use", _USES)
def test_using_a_name_changes_nothing_either(told: Told, use: str) -> None:
    assert told[use][0] == {}
