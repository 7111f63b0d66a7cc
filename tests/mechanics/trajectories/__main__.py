"""Make the recorded figures anew, and show what changed; or measure how far rounding carries runs apart.

    python -m tests.mechanics.trajectories record [NAME ...]
    python -m tests.mechanics.trajectories tolerances [NAME ...]

`record` keeps the tolerances. Record only what is meant to have changed, and say in the commit what and why.
"""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first of all: kernels and threads as in a process of the rig

# isort: split
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from . import figures
from .cases import CASES
from .figures import FloatArray, Line
from .observe import run

_SEEDS = 4
#: Processors as OpenBLAS names them: each sums in an order of its own, as another version of it does.
_OTHER_PROCESSORS = ("Prescott", "Nehalem", "Sandybridge")


def record(name: str, cache: Path) -> None:
    """Write what a case gives now, with the tolerances that it has, and print what is new."""
    found, before = figures.summary(run(CASES[name](cache))), figures.read(name)
    for key, share in sorted(figures.departures(found, before).items(), key=lambda each: -each[1]):
        at = int(np.abs(found[key] - before[key].values).argmax())
        was, now = before[key].values[at], found[key][at]
        print(f"{name} {key:18} {was:13.6e} -> {now:13.6e}: {share:.2g} tolerances")
    _write(name, {key: Line(before[key].tolerance, values) for key, values in found.items()})


def measure(name: str, cache: Path) -> None:
    """Write what a case gives now, and tolerances from runs that differ by rounding alone."""
    case = CASES[name](cache)
    plain = figures.summary(run(case))
    others = [figures.summary(run(case, jiggle=np.random.default_rng(seed))) for seed in range(_SEEDS)]
    others.append(figures.summary(run(case, start=1e-12)))
    others += [_on_processor(processor, name, cache / processor) for processor in _OTHER_PROCESSORS]
    tolerances = figures.tolerances(plain, others)
    _write(name, {key: Line(tolerances[key], values) for key, values in plain.items()})


def _write(name: str, lines: dict[str, Line]) -> None:
    path = figures.path_of(name)
    path.parent.mkdir(exist_ok=True)
    path.write_text(figures.text(name, lines))
    print(f"{path}: {path.stat().st_size} bytes; `git diff {path}` shows what changed")


def _on_processor(processor: str, name: str, folder: Path) -> dict[str, FloatArray]:
    """Return what a process gives whose linear algebra, and so the modes of its wall, is that of another processor."""
    folder.mkdir(exist_ok=True)
    environment = {**os.environ, "OPENBLAS_CORETYPE": processor}
    del environment["TROCAR_CACHE_DIR"]  # where kernels are
    command = [sys.executable, "-m", __spec__.name, "save", name, str(folder / "summary.npz")]
    subprocess.run(command, check=True, env=environment)
    with np.load(folder / "summary.npz") as saved:
        return dict(saved)


def main() -> None:
    """Run the verb for the cases named, or all."""
    verb, names = sys.argv[1] if len(sys.argv) > 1 else "", sys.argv[2:] or list(CASES)
    if verb == "save":  # for `_on_processor`
        os.environ["TROCAR_CACHE_DIR"] = str(Path(names[1]).parent)
        np.savez(names[1], **figures.summary(run(CASES[names[0]](Path(names[1]).parent))))
        return
    with tempfile.TemporaryDirectory() as cache:
        os.environ["TROCAR_CACHE_DIR"] = cache  # nothing built by another version, or with more threads
        if verb not in ("record", "tolerances"):
            raise SystemExit(__doc__)
        for name in names:
            (record if verb == "record" else measure)(name, Path(cache))


main()
