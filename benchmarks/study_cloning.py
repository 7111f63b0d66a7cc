"""Learning curves of behaviour cloning: ``python -m benchmarks.study_cloning``, a quarter of an hour of a core each.

For each of three seeds an expert with trembling hands is recorded in scenes that differ; policies that are cloned from
the first 1, 2, 4 and 8 of its episodes are tried in scenes that none of them has seen, and beside them the expert and
actions at random. Writes benchmarks/results/cloning.md and docs/results/cloning.svg of the insertion, and with
``--task navigation`` cloning-navigation.md and cloning-navigation.svg of the way into a branch.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from benchmarks.report import Row, parse, write_report
from trocar.envs.cloning import ClonedPolicy, clone, read_demonstrations
from trocar.envs.rollouts import Outcome, Policy, rollouts
from trocar.services.mechanics.arrays import Float32Array

COUNTS = (1, 2, 4, 8)
SEEDS = (0, 1, 2)
CURVES = Path(__file__).parents[1] / "docs" / "results"
POLICY = "A policy is ridge regression on 600 random Fourier features, as in `trocar.envs.cloning`.\n"


@dataclass(frozen=True)
class Task:
    """What is cloned.

    Attributes:
        name, title: Of the table's file, and over it.
        environment, settings: As for `rollouts`.
        most_steps: After which an episode is no success: twice what an expert takes.
        notes: What the table says of it.
    """

    name: str
    title: str
    environment: str
    settings: Mapping[str, Any]
    most_steps: int
    notes: str


INSERTION = Task(
    "cloning",
    "Behaviour cloning of the insertion",
    "trocar/Insertion-v0",
    {
        "randomise": {"catheter.tip_position_m.1": (-1.5e-3, 1.5e-3), "catheter.tip_position_m.2": (-1.5e-3, 1.5e-3)},
        # A coarse wall: hands that strike at tissue, as bad policies do, cost a fine one ten times the real time.
        "overrides": ("duct.n_around=20", "duct.n_along=26", "duct.n_modes=40"),
    },
    400,
    """Episodes of `trocar/Insertion-v0` that end in success, of {tries} a seed; the tip begins up to 1.5 mm beside
and above its place, the same scenes for every row; the wall has 20 x 26 cells. Depth is the mean at the end; the goal
is 10 mm. Demonstrations are an expert's with noise of 0.1 on each action; an episode that has not ended after 8 s,
twice what the expert takes, is no success.
""",
)
NAVIGATION = Task(
    "cloning-navigation",
    "Behaviour cloning of the way into a branch",
    "trocar/Navigation-v0",
    {
        "scenario": "endovascular",
        "randomise": {"catheter.youngs_modulus_pa": (22e6, 38e6), "effects.friction.mu_kinetic": (0.03, 0.05)},
    },
    600,
    """Episodes of `trocar/Navigation-v0` in scenario `endovascular` that end in success, of {tries} a seed; the
catheter's modulus is drawn from 22 to 38 MPa and friction from 0.03 to 0.05, the same scenes for every row. Depth is
the mean way at the end; the goal is 60 mm on the way into the subclavian artery. Demonstrations are an expert's with
noise of 0.1 on each action; an episode that has not ended after 12 s is no success.
""",
)


@dataclass
class Random:
    """Actions evenly drawn."""

    seed: int
    shape: tuple[int, ...]
    source: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.source = np.random.default_rng(self.seed)

    def __call__(self, _observation: Float32Array) -> Float32Array:
        return self.source.uniform(-1.0, 1.0, self.shape).astype(np.float32)


def demonstrate(task: Task, seed: int, folder: Path) -> list[Path]:
    """Return recordings of an expert, in the order in which they were made."""
    paths: list[Path] = []
    seeds = range(1000 * seed, 1000 * seed + max(COUNTS))
    for _ in rollouts(None, seeds, noise=0.1, environment=task.environment, record=str(folder), **task.settings):
        paths += sorted(set(folder.glob("*.mcap")) - set(paths))
    return paths


def try_out(task: Task, policy: Policy | None, seed: int, tries: int) -> list[Outcome]:
    """Return what a policy, or the expert, reaches in scenes that were not demonstrated."""
    begin = 1000 * seed + 500
    limits = {"environment": task.environment, "max_episode_steps": task.most_steps, **task.settings}
    return list(rollouts(policy, range(begin, begin + tries), **limits))


def row(name: str, by_seed: Sequence[Sequence[Outcome]]) -> Row:
    """Return how many of all episodes succeed, with each seed's number."""
    each = [sum(outcome.success for outcome in found) for found in by_seed]
    everything = [outcome for found in by_seed for outcome in found]
    depth_mm = 1e3 * float(np.mean([outcome.depth_m for outcome in everything]))
    note = f"{' + '.join(map(str, each))} of {len(everything)}, {depth_mm:.1f} mm deep"
    return Row(
        name, float(sum(each)), "episodes", note=note, extra={f"seed {s}": n for s, n in zip(SEEDS, each, strict=True)}
    )


def draw(rows: Sequence[Row], tries: int, expert: Row, path: Path) -> None:
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
    figure.savefig(path, metadata={"Date": None})


def cloned(task: Task, paths: Sequence[Path], seed: int) -> ClonedPolicy:
    """Return the policy that does what was recorded."""
    env = gymnasium.make(task.environment, **task.settings)
    env.reset(seed=seed)
    return clone(*read_demonstrations(paths, env=env.unwrapped), seed=seed)  # type: ignore[arg-type]


def main() -> None:
    """Play, write the table and draw the curve."""
    arguments = parse(
        __doc__,
        task=("insertion", "or navigation"),
        tries=(6, "episodes in which each policy is tried, a seed"),
    )
    task, tries = {"insertion": INSERTION, "navigation": NAVIGATION}[arguments.task], arguments.tries
    shape = gymnasium.make(task.environment, **task.settings).action_space.shape or ()
    found: dict[str, list[list[Outcome]]] = {}
    for seed in SEEDS:
        with tempfile.TemporaryDirectory() as folder:
            paths = demonstrate(task, seed, Path(folder))
            for n in COUNTS:
                policy = cloned(task, paths[:n], seed)
                name = f"{n} demonstration{'s' if n > 1 else ''}"
                found.setdefault(name, []).append(try_out(task, policy, seed, tries))
                print(seed, name, sum(each.success for each in found[name][-1]), flush=True)
        found.setdefault("the expert", []).append(try_out(task, None, seed, tries))
        found.setdefault("actions at random", []).append(try_out(task, Random(seed, shape), seed, tries))
    rows = [row(name, by_seed) for name, by_seed in found.items()]
    write_report(task.name, task.title, rows, task.notes.format(tries=tries) + POLICY)
    draw(rows[: len(COUNTS)], tries, rows[len(COUNTS)], CURVES / f"{task.name}.svg")


if __name__ == "__main__":
    main()
