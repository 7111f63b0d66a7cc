"""How long a rig takes to RUNNING, and how much processor time: warm, or with nothing compiled and no basis built.

    python benchmarks/bench_start.py [--cold] [--runs 3] [--against CHECKOUT] [trocar up's options]

With ``--cold`` each start has an empty cache of its own; without it one is filled by a start that is not counted, and
all others use it. ``--against`` names another checkout of the repository, whose starts take turns with those of this
one: within minutes a host is twice as slow, and tells nothing of two programs that were timed one after the other.
Each is called with the same options as the one before: options that were found sound once are not checked again.
Processor time is that of all processes of the rig until it says that it is running. Nothing but the table is written.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from report import RESULTS, Row, end_in_good_order, write_report

from trocar.services.diagnosis.thread_usage import threads_of

Taken = tuple[float, float]
"""Seconds to RUNNING, and seconds of processors."""

ROOT = Path(__file__).resolve().parents[1]
#: Asked of a start, in s.
_ASKED_S = {"cold": 45.0, "warm": 4.0}
_RUNNING = "is running"


def start(checkout: Path | None, cache: Path, options: list[str], python: str = sys.executable) -> Taken:
    """Start a rig and end it as soon as it runs; return the seconds until then, and of processors.

    It is that of a checkout, or the one that is installed in the environment of `python`.
    """
    places = [f"transport.directory={cache}/bus", "supervisor.web.port=0", "visualization.port=0"]
    overrides = [word for place in places for word in ("--set", place)]
    command = [python, "-c", "import sys; from trocar.services.cli.app import main; sys.exit(main())", "up"]
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment |= {"TROCAR_CACHE_DIR": str(cache), "PYTHONUNBUFFERED": "1"}
    environment["PYTHONPATH"] = "" if checkout is None else str(checkout)
    began_s = time.monotonic()
    process = subprocess.Popen(
        [*command, "--viewer", "web", *overrides, *options],
        cwd=checkout or cache, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        said = []
        for line in process.stdout:
            said.append(line)
            if _RUNNING in line:
                took_s = time.monotonic() - began_s
                living_s = sum(1e-9 * counts.ran_ns for _, counts in threads_of("rig", process.pid, ()))
                return took_s, living_s + _ended_s(process.pid)
    finally:
        process.terminate()
        process.communicate()
    raise SystemExit(f"{checkout or python}: the rig did not run:\n{''.join(said[-20:])}")


def _ended_s(pid: int) -> float:
    """Return the seconds of processors that children of a process took which have ended."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[13]) + int(fields[14])) / os.sysconf("SC_CLK_TCK")


def measure(checkouts: dict[str, Path], runs: int, options: list[str], *, cold: bool) -> dict[str, list[Taken]]:
    """Return the starts of each checkout, which took turns."""
    taken: dict[str, list[Taken]] = {name: [] for name in checkouts}
    with ExitStack() as stack:
        shared = {name: Path(stack.enter_context(tempfile.TemporaryDirectory())) for name in checkouts}
        if not cold:
            for name, checkout in checkouts.items():
                start(checkout, shared[name], options)
        for _ in range(runs):
            for name, checkout in checkouts.items():
                with tempfile.TemporaryDirectory() as own:
                    taken[name].append(start(checkout, Path(own) if cold else shared[name], options))
    return taken


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cold", action="store_true", help="with nothing compiled and no basis built")
    parser.add_argument("--runs", type=int, default=3, help="starts of each checkout")
    parser.add_argument("--against", type=Path, help="another checkout, which takes turns")
    arguments, options = parser.parse_known_args()
    end_in_good_order()
    kind = "cold" if arguments.cold else "warm"
    checkouts = {"": ROOT} | ({"the other checkout: ": arguments.against.resolve()} if arguments.against else {})
    rows = []
    for name, starts in measure(checkouts, arguments.runs, options, cold=arguments.cold).items():
        for what, values in zip(("start to RUNNING", "processor time"), zip(*starts, strict=True), strict=True):
            limit = _ASKED_S[kind] if what == "start to RUNNING" and not name else None
            median = sorted(values)[len(values) // 2]
            noise = (max(values) - min(values)) / median
            rows.append(Row(f"{name}{kind} {what}", median, "s", limit, noise=noise, extra={"least": min(values)}))
    notes = f"{arguments.runs} starts, medians; noise is their range over the median. {__doc__.split('.')[0]}."
    write_report(f"start-{kind}", f"{kind.capitalize()} start of the rig", rows, notes, RESULTS)


if __name__ == "__main__":
    main()
