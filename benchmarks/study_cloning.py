"""Learning curve of behaviour cloning: ``python -m benchmarks.study_cloning``, ten minutes of a core.

For each of three seeds an expert with trembling hands is recorded in scenes whose catheter begins elsewhere; policies
that are cloned from the first 1, 2, 4 and 8 of its episodes are tried in scenes that none of them has seen, and beside
them the expert and actions at random. Writes the table benchmarks/results/cloning.md and the curve
docs/results/cloning.svg.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.report import Row, parse, write_report
from services.mechanics.arrays import Float32Array
from trocar.envs.cloning import clone, read_demonstrations
from trocar.envs.rollouts import Outcome, Policy, rollouts

RANGES = {"catheter.tip_position_m.1": (-1.5e-3, 1.5e-3), "catheter.tip_position_m.2": (-1.5e-3, 1.5e-3)}
COUNTS = (1, 2, 4, 8)
WALL = ("duct.n_around=20", "duct.n_along=26", "duct.n_modes=40")
"""A coarse one: hands that strike at tissue, as those of bad policies do, cost a fine wall ten times the real time."""
SEEDS = (0, 1, 2)
MOST_STEPS = 400
"""Twice as many as an expert takes."""
CURVE = Path(__file__).parents[1] / "docs" / "results" / "cloning.svg"
NOTES = """Episodes of `trocar/Insertion-v0` that end in success, of {tries} a seed; the tip begins up to 1.5 mm beside
and above its place, the same scenes for every row; the wall has 20 x 26 cells. Depth is the mean at the end; the goal
is 10 mm. Demonstrations are an expert's with noise of 0.1 on each action; an episode that has not ended after 8 s,
twice what the expert takes, is no success. A policy is ridge regression on 600 random Fourier features, as in
`trocar.envs.cloning`.
"""


@dataclass
class Random:
    """Actions evenly drawn."""

    seed: int
    source: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.source = np.random.default_rng(self.seed)

    def __call__(self, _observation: Float32Array) -> Float32Array:
        return self.source.uniform(-1.0, 1.0, (2, 5)).astype(np.float32)


def demonstrate(seed: int, folder: Path) -> list[Path]:
    """Return recordings of an expert, in the order in which they were made."""
    paths: list[Path] = []
    for _ in rollouts(
        None,
        range(1000 * seed, 1000 * seed + max(COUNTS)),
        noise=0.1,
        record=str(folder),
        randomise=RANGES,
        overrides=WALL,
    ):
        paths += sorted(set(folder.glob("*.mcap")) - set(paths))
    return paths


def try_out(policy: Policy | None, seed: int, tries: int) -> list[Outcome]:
    """Return what a policy, or the expert, reaches in scenes that were not demonstrated."""
    begin = 1000 * seed + 500
    return list(
        rollouts(policy, range(begin, begin + tries), randomise=RANGES, overrides=WALL, max_episode_steps=MOST_STEPS)
    )


def row(name: str, by_seed: Sequence[Sequence[Outcome]]) -> Row:
    """Return how many of all episodes succeed, with each seed's number."""
    each = [sum(outcome.success for outcome in found) for found in by_seed]
    everything = [outcome for found in by_seed for outcome in found]
    depth_mm = 1e3 * float(np.mean([outcome.depth_m for outcome in everything]))
    note = f"{' + '.join(map(str, each))} of {len(everything)}, {depth_mm:.1f} mm deep"
    return Row(
        name, float(sum(each)), "episodes", note=note, extra={f"seed {s}": n for s, n in zip(SEEDS, each, strict=True)}
    )


def draw(rows: Sequence[Row], tries: int, expert: Row) -> None:
    """Draw the curve: a thin line a seed, their mean, and the expert."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 3.0), layout="constrained")
    axes = figure.subplots()
    for seed in SEEDS:
        shares = [each.extra[f"seed {seed}"] / tries for each in rows]
        axes.plot(COUNTS, shares, "o-", lw=0.8, ms=3, alpha=0.5, label=f"seed {seed}")
    axes.plot(COUNTS, [each.value / (tries * len(SEEDS)) for each in rows], "k-", lw=2, label="mean")
    axes.axhline(expert.value / (tries * len(SEEDS)), color="k", ls="--", lw=0.8, label="expert")
    axes.set(xscale="log", xticks=COUNTS, xticklabels=map(str, COUNTS), ylim=(-0.05, 1.05))
    axes.set(xlabel="demonstrations", ylabel="share of episodes that succeed")
    axes.minorticks_off()
    axes.legend(fontsize="small")
    figure.savefig(CURVE, metadata={"Date": None})


def main() -> None:
    """Play, write the table and draw the curve."""
    tries = parse(__doc__, tries=(6, "episodes in which each policy is tried, a seed")).tries
    found: dict[str, list[list[Outcome]]] = {}
    for seed in SEEDS:
        with tempfile.TemporaryDirectory() as folder:
            paths = demonstrate(seed, Path(folder))
            for n in COUNTS:
                policy = clone(*read_demonstrations(paths[:n]), seed=seed)
                name = f"{n} demonstration{'s' if n > 1 else ''}"
                found.setdefault(name, []).append(try_out(policy, seed, tries))
                print(seed, name, sum(each.success for each in found[name][-1]), flush=True)
        found.setdefault("the expert", []).append(try_out(None, seed, tries))
        found.setdefault("actions at random", []).append(try_out(Random(seed), seed, tries))
    rows = [row(name, by_seed) for name, by_seed in found.items()]
    write_report("cloning", "Behaviour cloning of the insertion", rows, NOTES.format(tries=tries))
    draw(rows[: len(COUNTS)], tries, rows[len(COUNTS)])


if __name__ == "__main__":
    main()
