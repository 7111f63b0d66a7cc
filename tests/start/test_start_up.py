"""What a process of the rig does while it imports, and what it does not import."""

from __future__ import annotations

import gc
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from trocar.services.start import start_up

SERVICES = Path(start_up.__file__).parents[1]
PROCESSES = sorted(path.parent.name for path in SERVICES.glob("*/__main__.py"))
_BUILD = "trocar.services.mechanics.fem.nonlinear", "trocar.services.mechanics.reduction.softening.training"
_SCIPY = "scipy.sparse", "scipy.spatial", "scipy.linalg", "scipy.optimize"
#: By process, what only a basis is built with.
BUILDERS = dict.fromkeys(PROCESSES, ()) | dict.fromkeys(
    ("physics", "haptics", "visualization", "recorder"), (*_BUILD, *_SCIPY)
)


@pytest.fixture(autouse=True)
def collector() -> Iterator[None]:
    thresholds = gc.get_threshold()
    yield
    gc.unfreeze()
    gc.enable()
    gc.set_threshold(*thresholds)


@pytest.mark.parametrize("process", PROCESSES)
def test_a_process_imports_without_looking_for_garbage(process: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["-m", "--rig", "stub"])
    monkeypatch.setattr(sys, "orig_argv", ["python", "-m", f"trocar.services.{process}", "--rig", "stub"])
    start_up.begin()
    assert not gc.isenabled()
    start_up.end()
    assert gc.isenabled()
    assert gc.get_freeze_count() > 0


@pytest.mark.parametrize(
    ("argv", "asked"),
    [
        (["-m"], ["python", "-m", "trocar.services.gateway.simulated.drive_process"]),
        (["-m"], ["python", "-m", "trocar.services.cli.app"]),
        (["-m"], ["python", "-m"]),
        (["-c"], ["python", "-c", "from trocar import services"]),
        (["/usr/bin/pytest"], ["python", "-m", "trocar.services.physics"]),
    ],
)
def test_nobody_else_does_who_would_not_switch_it_on_again(
    argv: list[str], asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", argv)
    monkeypatch.setattr(sys, "orig_argv", asked)
    start_up.begin()
    assert gc.isenabled()


def test_what_lives_is_not_looked_through_again_and_again_while_a_process_builds() -> None:
    """A compiler makes millions of objects that live: numba's own, and the code that callers link."""
    kept: list[list[object]] = []
    start_up.end()
    before = gc.get_stats()
    kept.extend([] for _ in range(3_000_000))
    young, middle, all_there_is = (
        after["collections"] - was["collections"] for after, was in zip(gc.get_stats(), before, strict=True)
    )
    assert (young > 0, middle > 0, all_there_is) == (True, True, 0)


def test_who_collects_while_a_loop_runs_looks_through_little_at_once_and_at_all_there_is_some_time() -> None:
    """The supervisor, for days: what has lived through two looks dies too."""
    script = (
        "import gc; pythons = gc.get_threshold()\n"
        "from trocar.services.start import start_up; from trocar.services.runtime.realtime import realtime\n"
        "start_up.end(); realtime.freeze_garbage_collector(); gc.enable()\n"
        "print(gc.get_threshold() == pythons)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True"]


@pytest.mark.parametrize("process", PROCESSES)
def test_a_process_collects_garbage_again_before_it_begins_and_imports_nothing_to_build_with(process: str) -> None:
    """Each file of a process reaches `end`: a command line that is refused tells that it came so far."""
    script = (
        "import gc, runpy, sys\n"
        f"sys.orig_argv[:] = ['python', '-m', 'trocar.services.{process}']; sys.argv[:] = ['-m']\n"
        "import trocar.services.start.entry; assert not gc.isenabled()\n"
        f"sys.argv[:] = ['{process}', '--no-such-option']\n"
        "try:\n"
        f"    runpy.run_module('trocar.services.{process}', run_name='__main__')\n"
        "except SystemExit:\n"
        f"    print('on' if gc.isenabled() else 'off', *set({BUILDERS[process]!r}) & set(sys.modules))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["on"]


def test_a_supervisor_that_is_to_prepare_only_starts_no_rig() -> None:
    command = [sys.executable, "-m", "trocar.services.supervisor", "--prepare-only"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
