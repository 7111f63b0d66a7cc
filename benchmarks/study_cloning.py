"""Learning curve of behaviour cloning: ``python -m benchmarks.study_cloning`` prints a table for docs/results/envs.md.

For each seed an expert with trembling hands is recorded in scenes whose catheter begins elsewhere; policies that are
cloned from the first 1, 2, 4 and 8 of its episodes are tried in scenes that none of them has seen.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from benchmarks.report import parse
from trocar.envs.cloning import clone, read_demonstrations
from trocar.envs.rollouts import rollouts

RANGES = {"catheter.tip_position_m.1": (-1.5e-3, 1.5e-3), "catheter.tip_position_m.2": (-1.5e-3, 1.5e-3)}
COUNTS = (1, 2, 4, 8)


def main() -> None:
    """Print a row a seed."""
    tries = parse(__doc__, tries=(6, "episodes in which each policy is tried")).tries
    print("| seed | " + " | ".join(f"{n} episodes" for n in COUNTS) + " |\n| --- " * 1 + "| --- " * len(COUNTS) + "|")
    for seed in range(3):
        with tempfile.TemporaryDirectory() as folder:
            seeds = range(1000 * seed, 1000 * seed + max(COUNTS))
            for _ in rollouts(None, seeds, noise=0.1, record=folder, randomise=RANGES):
                pass
            paths = sorted(Path(folder).glob("*.mcap"), key=lambda path: path.stat().st_mtime)
            cells = []
            for n in COUNTS:
                policy = clone(*read_demonstrations(paths[:n]), seed=seed)
                tried = range(1000 * seed + 500, 1000 * seed + 500 + tries)
                found = list(rollouts(policy, tried, randomise=RANGES))
                depth_mm = 1e3 * sum(each.depth_m for each in found) / len(found)
                cells.append(f"{sum(each.success for each in found)} of {tries}, {depth_mm:.1f} mm")
            print(f"| {seed} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    sys.exit(main())
