"""All tests, in two parts: ``python -m tests [what pytest takes]``, which ``./dev test`` runs.

First everything that shares the machine: a worker a core and one more, as many tests wait for processes, a file stays
with one of them. Then, alone, what starts a rig that is judged: a rig beside busy neighbours is late, and rightly
called so. One summary counts both; either part fails the run. Where all tests are run, physics and haptics compile
before, each its share, so that no two workers compile the same. What failed is told again at the end, and which files
took longest: they begin first the next time.

``--long``, by hand and before a release, also runs what is marked ``long``; then all hard cases of a seed that nobody
has seen (``--seed S``: that one), and what is left of the proofs by chance (``tests/proofs``). Their rates are tables
in ``docs/results``.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

from tests import file_seconds
from trocar.services.files.cache_directory import cache_directory
from trocar.services.kernels import kernel_cache
from trocar.services.kernels.source_closure import Sources

#: A worker of the mechanics holds 0.7 GB, and beyond four the longest file decides.
_MOST_WORKERS = 4
#: The slow files are in the middle of the order of collection, the quick ones at its end.
_TOGETHER = ("-m", "not rig", "--dist", "loadfile", "--no-loadscope-reorder")
_ALONE = ("-m", "rig")
_NOTHING_CHOSEN = 5
_PREPARE = """
import importlib, sys
from trocar.services.runtime.process.process import Options, load_process_config
name, scene = sys.argv[1:]
process = importlib.import_module(f"trocar.services.{name}.__main__")
process.prepare(load_process_config(name, Options("stub", scene, ())))
"""


#: Tests as pytest has rewritten them are kept, whatever is asked of Python elsewhere: each worker would take a quarter
#: of a minute to make them anew. They lie in the cache, not in the tree. And what Python does at its end is short.
_ENVIRONMENT = {
    "PYTHONDONTWRITEBYTECODE": "",
    "PYTHONPYCACHEPREFIX": str(cache_directory() / "bytecode"),
    "PYTHONPATH": os.pathsep.join(
        [f"{Path(__file__).parent / 'at_start'}", *filter(None, [os.environ.get("PYTHONPATH")])]
    ),
}
_PAGE = Path(__file__).parents[1] / "docs" / "results" / "stability.md"
_MOST_SEED = 2**31


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one run of pytest came to."""

    exit_code: int
    passed: int
    failed: int
    skipped: int
    elapsed_s: float
    failures: tuple[str, ...] = ()
    file_s: dict[str, float] = field(default_factory=dict)
    """What the tests of each file took, by its dotted name."""


def run_part(options: tuple[str, ...], arguments: list[str]) -> Outcome:
    """Run pytest with its own output, and return its counts."""
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        report, seconds = Path(folder) / "report.xml", Path(folder) / "seconds.json"
        seconds.write_text(json.dumps(file_seconds.of_last_run()), encoding="utf-8")
        environment = {**os.environ, **_ENVIRONMENT, file_seconds.COPY: str(seconds)}
        command = [sys.executable, "-m", "pytest", *options, f"--junitxml={report}", *arguments]
        exit_code = subprocess.run(command, check=False, env=environment).returncode
        passed, failed, skipped = _counts(report) if report.exists() else (0, 0, 0)
        failures = _failures(report) if failed else ()
        file_s = file_seconds.seconds_of(report) if report.exists() else {}
    return Outcome(exit_code, passed, failed, skipped, time.monotonic() - began_s, failures, file_s)


def _counts(report: Path) -> tuple[int, int, int]:
    suite = next(ElementTree.parse(report).iter("testsuite"))
    every, failures, errors, skipped = (int(suite.get(name, 0)) for name in ("tests", "failures", "errors", "skipped"))
    return every - failures - errors - skipped, failures + errors, skipped


def _failures(report: Path) -> tuple[str, ...]:
    """Return of each test that failed its name and what pytest says of it."""
    told = []
    for case in ElementTree.parse(report).iter("testcase"):
        name = f"{case.get('classname')}::{case.get('name')}"
        told += [f"=== {name}\n{part.text}" for part in case if part.tag in ("failure", "error")]
    return tuple(told)


def exit_code(parts: list[Outcome]) -> int:
    """Return the code of the first part that failed. That none of its tests was chosen fails a part only if all are so.

    A part that crashed before it could count is a failure like any other.
    """
    codes = [part.exit_code for part in parts]
    failures = [code for code in codes if code not in (0, _NOTHING_CHOSEN)]
    if failures:
        return failures[0]
    return 0 if 0 in codes else _NOTHING_CHOSEN


def summary(parts: list[Outcome]) -> str:
    """Return the totals in one line."""
    passed, failed, skipped = (sum(getattr(part, name) for part in parts) for name in ("passed", "failed", "skipped"))
    times = " + ".join(f"{part.elapsed_s:.0f}" for part in parts)
    total_s = sum(part.elapsed_s for part in parts)
    return f"all tests: {passed} passed, {failed} failed, {skipped} skipped in {total_s:.0f} s ({times})"


def compile_kernels() -> float:
    """Let physics and haptics compile, as they do beside each other when a rig starts; return the seconds taken.

    What they say of that, and of a failure, is left to the tests, which do the same again. Where the same sources have
    been compiled before, which a file beside the kernels tells, that takes no time.
    """
    began_s, scene = time.monotonic(), str(Path(__file__).parent / "scenes" / "small.yaml")
    done = kernel_cache.root() / f"tests-{_sources_of('physics', 'haptics')}.done"
    if done.exists():
        return 0.0
    with tempfile.TemporaryDirectory() as bases:
        environment = {"NUMBA_CACHE_DIR": str(kernel_cache.root()), **os.environ, "TROCAR_CACHE_DIR": bases}
        commands = [[sys.executable, "-c", _PREPARE, name, scene] for name in ("physics", "haptics")]
        running = [subprocess.Popen(each, env=environment, stderr=subprocess.DEVNULL) for each in commands]
        codes = [process.wait() for process in running]
    if not any(codes):
        done.touch()
    return time.monotonic() - began_s


def _sources_of(*processes: str) -> str:
    """Return what names all that processes compile, and what compiles it."""
    sources = Sources(Path(__file__).parents[1])
    made_of = [sources.digest(f"trocar.services.{name}.__main__") for name in processes]
    versions = [version(name) for name in ("numba", "llvmlite", "numpy")]
    return hashlib.sha256("\n".join([*made_of, *versions]).encode()).hexdigest()[:16]


def main(arguments: list[str]) -> int:
    """Run both parts, the second also after a failure of the first, unless the first was interrupted."""
    seed = _take_seed(arguments)
    if not [word for word in arguments if word != "--long"]:
        print("compiling kernels", flush=True)
        print(f"kernels are compiled ({compile_kernels():.0f} s)", flush=True)
    workers = min(1 + (os.cpu_count() or 1), _MOST_WORKERS)
    parts = [run_part(("-n", str(workers), *_TOGETHER), arguments)]
    if parts[0].exit_code != 2:  # interrupted, or -x
        parts.append(run_part(_ALONE, arguments))
    if parts[0].file_s:
        file_seconds.keep_seconds(parts[0].file_s)
        print(file_seconds.longest(parts[0].file_s))
    for told in [told for part in parts for told in part.failures]:
        print(told)  # once more: whoever sees only the end of a long output wants to know
    print(summary(parts))
    rates = measure_rates(seed) if "--long" in arguments and parts[0].exit_code != 2 else 0
    return exit_code(parts) or rates


def _take_seed(arguments: list[str]) -> int:
    """Take ``--seed S`` out of the arguments; without it a seed is drawn."""
    if "--seed" not in arguments:
        return secrets.randbelow(_MOST_SEED)
    at = arguments.index("--seed")
    seed = int(arguments[at + 1])
    del arguments[at : at + 2]
    return seed


def measure_rates(seed: int) -> int:
    """Run what is a matter of rates, write its tables, and return an exit code that says whether anything failed."""
    print(f"rates over fresh cases, seed {seed}; `python -m tests --long --seed {seed}` runs them again", flush=True)
    commands = [
        ["-m", "trocar.services.cli.app", "stability", "--long", "--seed", f"{seed}", "--report", f"{_PAGE}"],
        ["-m", "tests.proofs"],
    ]
    return max([subprocess.run([sys.executable, *command], check=False).returncode for command in commands])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
