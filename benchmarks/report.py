"""What every benchmark shares: its options, interleaved timing and a committed table.

    from report import Row, measure, parse, write_report

    arguments = parse(__doc__, samples=(2000, "steps of each"))
    timings = measure({"r = 60": step_60, "r = 100": step_100}, samples=arguments.samples)
    rows = [Row.from_timing(name, timing, limit_s=5e-6) for name, timing in timings.items()]
    write_report("duct", "Reduced duct", rows)

The callables are interleaved sample by sample, so that a slow spell of the machine falls on all of
them alike and ratios between them stay meaningful. The median is what budgets are judged by; the
99th percentile and the noise (interquartile range over median) say how far to trust it.
"""

from __future__ import annotations

import argparse
import gc
import json
import math
import os
import platform
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import FrameType

import numpy as np
from scipy import stats

from trocar.services.mechanics.arrays import FloatArray
from trocar.services.runtime.realtime.machine import processor_name

RESULTS = Path(__file__).resolve().parent / "results"
PACKAGES = ("numpy", "scipy", "numba", "msgspec", "msgpack", "pyzmq", "pyvista")


def parse(document: str | None, /, **options: tuple[int | float | str, str]) -> argparse.Namespace:
    """Return the options of a benchmark's command line; ``--help`` shows its module's text and each of them.

    Args:
        document: The module's docstring.
        options: By name: what holds where an option is not given, whose type it has, and what it is.
    """
    parser = argparse.ArgumentParser(description=document, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, (default, what) in options.items():
        parser.add_argument(f"--{name}", type=type(default), default=default, help=f"{what} (default {default})")
    return parser.parse_args()


def end_in_good_order() -> None:
    """Let SIGTERM end a benchmark as Ctrl-C does: what it has started is ended with it."""

    def end(number: int, _frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    signal.signal(signal.SIGTERM, end)


@dataclass(frozen=True)
class Timing:
    """Seconds per call over many samples; `noise` is interquartile range over median."""

    median_s: float
    p99_s: float
    min_s: float
    noise: float
    samples: int

    @classmethod
    def from_samples(cls, seconds: np.ndarray) -> Timing:
        low, median, high, p99 = np.percentile(seconds, [25, 50, 75, 99])
        noise = float((high - low) / median)
        return cls(float(median), float(p99), float(seconds.min()), noise, len(seconds))


@dataclass(frozen=True)
class Row:
    """One line of a result table: a measured value, its unit and, where one is set, its budget.

    `limit` is an upper bound on `value` unless `at_least` is true.
    """

    name: str
    value: float
    unit: str
    limit: float | None = None
    p99: float | None = None
    noise: float | None = None
    at_least: bool = False
    note: str = ""
    extra: dict[str, float] = field(default_factory=dict)

    @classmethod
    def from_timing(cls, name: str, timing: Timing, limit_s: float | None = None, note: str = "") -> Row:
        """Row in the SI multiple that reads best (ns, us, ms or s)."""
        scale, unit = _time_unit(timing.median_s)
        limit = None if limit_s is None else limit_s * scale
        return cls(name, timing.median_s * scale, unit, limit, timing.p99_s * scale, timing.noise, note=note)

    @property
    def passed(self) -> bool | None:
        """Whether the budget is kept; None where there is none."""
        if self.limit is None:
            return None
        return self.value >= self.limit if self.at_least else self.value <= self.limit


def measure(
    callables: Mapping[str, Callable[[], object]],
    *,
    samples: int = 1000,
    inner: int = 1,
    warmup: int = 10,
) -> dict[str, Timing]:
    """Time callables interleaved; each sample is the mean of `inner` calls in a row.

    Use `inner` > 1 for calls below a few microseconds: one reading of the clock costs about 50 ns.
    The collector is off while measuring, as it is in the 1 kHz loops.
    """
    for call in callables.values():
        for _ in range(warmup):
            call()
    seconds = {name: np.empty(samples) for name in callables}
    collecting = gc.isenabled()
    gc.disable()
    try:
        for sample in range(samples):
            for name, call in callables.items():
                seconds[name][sample] = _time_once(call, inner)
    finally:
        if collecting:
            gc.enable()
    return {name: Timing.from_samples(values) for name, values in seconds.items()}


def _time_once(call: Callable[[], object], inner: int) -> float:
    start = time.perf_counter_ns()
    for _ in range(inner):
        call()
    return (time.perf_counter_ns() - start) * 1e-9 / inner


def noise(differences: FloatArray) -> float:
    """Return what the mean of paired differences (n,) stays below by chance: 95 %, by Student's t."""
    n = len(differences)
    return float(stats.t.ppf(0.975, n - 1) * differences.std(ddof=1) / math.sqrt(n)) if n > 1 else math.inf


def write_report(
    name: str, title: str, rows: Iterable[Row], notes: str = "", folder: Path = RESULTS
) -> tuple[Path, Path]:
    """Write `<name>.md` and `<name>.json` with the machine, versions, date and command; return both paths."""
    rows = list(rows)
    context = describe_run()
    folder.mkdir(parents=True, exist_ok=True)
    table, data = folder / f"{name}.md", folder / f"{name}.json"
    table.write_text(_markdown(title, rows, notes, context), encoding="utf-8")
    records = [{**asdict(row), "passed": row.passed} for row in rows]
    document = {"title": title, "run": context, "notes": notes, "rows": records}
    data.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    print(_markdown(title, rows, notes, context))
    return table, data


def describe_run() -> dict[str, str]:
    """Machine, versions, date, commit and command, as they belong beside any number."""
    run = {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "command": shlex.join(["python", *map(_relative, sys.orig_argv[1:])]),
        "commit": commit(),
        "cpu": processor_name(),
        "cores": str(os.cpu_count()),
        "load": f"{os.getloadavg()[0]:.1f}",
        "kernel": platform.release(),
        "python": platform.python_version(),
    }
    for package in PACKAGES:
        try:
            run[package] = version(package)
        except PackageNotFoundError:
            continue
    return run


def _markdown(title: str, rows: list[Row], notes: str, context: dict[str, str]) -> str:
    lines = [f"# {title}", ""]
    if notes:
        lines += [notes.strip(), ""]
    lines += _table([_cells(row) for row in rows])
    lines += ["", *(f"- {key}: {value}" for key, value in context.items()), ""]
    return "\n".join(lines)


def _cells(row: Row) -> dict[str, str]:
    sign = "≥" if row.at_least else "≤"
    value = "median" if row.p99 is not None else "value"
    return {
        "what": f"{row.name} ({row.note})" if row.note else row.name,
        value: f"{_round(row.value)} {row.unit}",
        "99 %": "" if row.p99 is None else f"{_round(row.p99)} {row.unit}",
        "noise": "" if row.noise is None else f"{row.noise:.0%}",
        "budget": "" if row.limit is None else f"{sign} {_round(row.limit)} {row.unit}",
        "kept": {None: "", True: "yes", False: "**no**"}[row.passed],
    }


def _table(cells: list[dict[str, str]]) -> list[str]:
    """Markdown table; a column that no row fills is left out, medians and single values share one."""
    names = ["what", "median", "99 %", "noise", "budget", "kept"]
    if not any("median" in row for row in cells):
        names[1] = "value"
    merged = [{**row, names[1]: row.get("median") or row.get("value", "")} for row in cells]
    shown = [name for name in names if any(row.get(name) for row in merged)]
    lines = ["| " + " | ".join(shown) + " |", "|---" * len(shown) + "|"]
    return lines + ["| " + " | ".join(row.get(name, "") for name in shown) + " |" for row in merged]


def _time_unit(seconds: float) -> tuple[float, str]:
    for scale, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "us")):
        if seconds * scale >= 1.0:
            return scale, unit
    return 1e9, "ns"


def _round(value: float) -> str:
    """Three significant digits, never in exponent form for the sizes that occur here."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value}"
    digits = 2 - math.floor(math.log10(abs(value)))
    return f"{value:.{max(digits, 0)}f}" if digits < 7 else f"{value:.2e}"


def _relative(word: str) -> str:
    """Return a word of a command line; a script by its place in the repository, wherever it was run."""
    root, place = RESULTS.parent.parent, Path(word).absolute()
    return str(place.relative_to(root)) if place.suffix == ".py" and place.is_relative_to(root) else word


def commit() -> str:
    """Return the abbreviated hash of what is checked out."""
    command = ["git", "rev-parse", "--short", "HEAD"]
    done = subprocess.run(command, cwd=RESULTS.parent, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"
