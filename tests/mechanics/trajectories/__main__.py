"""Make the recorded runs anew, or measure how far rounding carries them apart.

    python -m tests.mechanics.trajectories record [NAME ...]
    python -m tests.mechanics.trajectories sensitivity [NAME ...]

Record only what is meant to have changed, and say in the commit what and why.
"""

from __future__ import annotations

import trocar.services.entry  # noqa: F401  first of all: kernels and threads as in a process of the rig

# isort: split
import os
import sys
import tempfile
from pathlib import Path

import numpy

from . import stored
from .cases import CASES
from .compare import deviations
from .observe import machine, run


def main() -> None:
    """Run the verb for the cases named, or all."""
    verb, names = sys.argv[1], sys.argv[2:] or list(CASES)
    with tempfile.TemporaryDirectory() as cache:
        os.environ["TROCAR_CACHE_DIR"] = cache  # nothing built by another version, or with more threads
        for name in names:
            case = CASES[name](Path(cache))
            if verb == "record":
                path = stored.save(name, machine(), run(case))
                print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")
            elif verb == "sensitivity":
                plain = run(case)
                apart = [deviations(run(case, numpy.random.default_rng(seed)), plain) for seed in range(5)]
                print(name, {key: max(one[key] for one in apart) for key in apart[0]})
            else:
                raise SystemExit(__doc__)


main()
