"""What a newcomer waits for: the first start from a clone, a wheel and an image, and what each has to be fetched.

    python benchmarks/bench_first_start.py --wheel dist/trocar-…whl --image trocar [--runs 3]

The wheel is installed in an environment of its own. Beside it, in the folder of each start, lie modules of a stranger
that are named as our parts once were. Each start has an empty cache. Kernels compiled are those in the cache after the
start beyond those that came with the package. A clone's `trocar` is that of this checkout, without shipped kernels.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from bench_start import ROOT, start
from report import Row, end_in_good_order, parse, write_report

#: Asked of a start from a wheel, and of the example, in s.
_ASKED_S, _ASKED_EXAMPLE_S = 10.0, 5.0
_EXAMPLE = "trocar.examples.poke"


_COUNT = """
import tarfile, zstandard
from trocar.services.kernels.kernel_archive import FOLDER, SUFFIX
count = 0
for path in FOLDER.glob("*" + SUFFIX):
    with path.open("rb") as packed, zstandard.ZstdDecompressor().stream_reader(packed) as plain:
        with tarfile.open(fileobj=plain, mode="r|") as archive:
            count += sum(member.name.endswith(".nbc") for member in archive)
print(count)
"""


def main() -> None:
    """Measure and write the table."""
    arguments = parse(__doc__, wheel=("", "the wheel"), image=("", "an image's name"), runs=(3, "starts of each"))
    end_in_good_order()
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        if arguments.wheel:
            python = install(Path(arguments.wheel), Path(folder))
            rows += starts("wheel", None, python, arguments.runs)
            rows.append(example(python, Path(folder), arguments.runs))
            rows.append(Row("the wheel", Path(arguments.wheel).stat().st_size / 1e6, "MB"))
        rows += starts("clone", ROOT, sys.executable, 1)
        rows += clone(Path(folder))
    if arguments.image:
        rows += image(arguments.image, arguments.runs)
    notes = f"Medians; noise is the range over the median. {__doc__.split(chr(10), maxsplit=1)[0]}"
    write_report("first-start", "First start", rows, notes)


def install(wheel: Path, folder: Path) -> str:
    """Return the Python of a new environment with the wheel in it."""
    subprocess.run([sys.executable, "-m", "venv", folder / "wheel"], check=True)
    python = str(folder / "wheel" / "bin" / "python")
    subprocess.run([python, "-m", "pip", "install", "--quiet", f"{wheel.resolve()}[view]"], check=True)
    return python


def starts(name: str, checkout: Path | None, python: str, runs: int) -> list[Row]:
    """Return the rows of first starts: time, processor time, kernels compiled."""
    taken, compiled = [], []
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as cache:
            strangers_modules(Path(cache))
            taken.append(start(checkout, Path(cache), ["--viewer", "none"], python))
            compiled.append(len(list(Path(cache).rglob("*.nbc"))) - shipped(python, checkout))
    times_s, processor_s = zip(*taken, strict=True)
    limit_s = _ASKED_S if name == "wheel" else None
    return [
        row(f"{name}: first start to RUNNING", times_s, limit_s),
        row(f"{name}: processor time until then", processor_s),
        Row(f"{name}: kernels compiled", max(compiled), "", 0.0 if name == "wheel" else None),
    ]


def strangers_modules(folder: Path) -> None:
    """Write modules of somebody else that are named as parts of ours once were."""
    for name in ("services", "review", "studies", "protocol"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text('raise ImportError("a module of somebody else")\n')


def shipped(python: str, checkout: Path | None) -> int:
    """Return how many kernels came with the package."""
    if checkout is not None:
        return 0
    told = subprocess.run([python, "-c", _COUNT], cwd="/", capture_output=True, text=True, check=True)
    return int(told.stdout)


def example(python: str, folder: Path, runs: int) -> Row:
    """Return how long the first example takes, each time with an empty cache."""
    times_s = []
    for number in range(runs):
        cache = folder / f"example-{number}"
        cache.mkdir()
        strangers_modules(cache)
        began_s = time.monotonic()
        environment = {**os.environ, "TROCAR_CACHE_DIR": str(cache), "PYTHONPATH": ""}
        subprocess.run([python, "-m", _EXAMPLE], check=True, cwd=cache, env=environment, stdout=subprocess.DEVNULL)
        times_s.append(time.monotonic() - began_s)
    return row(f"wheel: python -m {_EXAMPLE}, first time", times_s, _ASKED_EXAMPLE_S)


def clone(folder: Path) -> list[Row]:
    """Return the bytes of a clone, whole and of the newest commit alone, and of what the last commits added."""
    whole, newest = folder / "whole", folder / "newest"
    address = f"file://{ROOT}"
    subprocess.run(["git", "clone", "--quiet", "--bare", address, whole], check=True)
    subprocess.run(["git", "clone", "--quiet", "--bare", "--depth", "1", address, newest], check=True)
    return [
        Row("a clone, all of the history", bytes_in(whole) / 1e6, "MB"),
        Row("a clone of depth 1", bytes_in(newest) / 1e6, "MB"),
        Row("objects that the last 20 commits added, packed", added_bytes("HEAD~20") / 1e6, "MB"),
    ]


def bytes_in(folder: Path) -> int:
    """Return the bytes of all files below a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def added_bytes(before: str) -> int:
    """Return the bytes of a pack of all objects that came after a commit."""
    asked = f"HEAD\n^{before}\n"
    command = ["git", "pack-objects", "--revs", "--stdout", "--quiet"]
    return len(subprocess.run(command, cwd=ROOT, input=asked.encode(), capture_output=True, check=True).stdout)


def image(name: str, runs: int) -> list[Row]:
    """Return how long a container takes to a running rig, with the caches that the image has, and the image's bytes."""
    times_s = [container(name) for _ in range(runs)]
    told = subprocess.run(["docker", "image", "inspect", "-f", "{{.Size}}", name], capture_output=True, check=True)
    return [row("image: first start to RUNNING", times_s), Row("the image", int(told.stdout) / 1e6, "MB")]


def container(name: str) -> float:
    """Return the seconds from `docker compose up` until the rig runs; its project and its volumes are new."""
    compose = ["docker", "compose", "--project-name", "trocar-first-start", "--profile", "stub"]
    environment = {**os.environ, "WEB_PORT": "18090", "VIEW_PORT": "18091"}
    began_s, said = time.monotonic(), []
    with subprocess.Popen(
        [*compose, "up", "--no-build"],
        cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        try:
            for line in process.stdout:
                said.append(line)
                if "is running" in line:
                    return time.monotonic() - began_s
        finally:
            process.terminate()
            subprocess.run(
                [*compose, "down", "--volumes", "--timeout", "5"], cwd=ROOT, capture_output=True, check=False
            )
    raise SystemExit(f"{name}: the rig did not run:\n{''.join(said[-20:])}")


def row(name: str, values: Sequence[float], limit: float | None = None) -> Row:
    """Return the row of some times, s."""
    median = statistics.median(values)
    return Row(name, median, "s", limit, noise=(max(values) - min(values)) / median)


if __name__ == "__main__":
    main()
