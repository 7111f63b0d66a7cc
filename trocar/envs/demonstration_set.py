"""A set of an expert's insertions: recordings, and the same as a dataset of LeRobot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from trocar.envs.lerobot import export_dataset
from trocar.envs.randomisation import Bound
from trocar.envs.rollouts import Outcome, rollouts
from trocar.services.runtime.errors import ConfigError

EPISODES = 50
TREMBLE = 0.1
"""Standard deviation of the noise on each action: what is seen beside the expert's way teaches how to come back."""
RANGES: Mapping[str, tuple[Bound, Bound]] = MappingProxyType(
    {"catheter.tip_position_m.1": (-1.5e-3, 1.5e-3), "catheter.tip_position_m.2": (-1.5e-3, 1.5e-3)}
)
"""Where the tip begins: up to 1.5 mm beside and above its place."""
FPS = 50


@dataclass(frozen=True, slots=True)
class DemonstrationSet:
    """A set as it was made.

    Attributes:
        recordings: Files of the rig, one an episode.
        dataset: Folder of the dataset of LeRobot.
        successes: Number of episodes that succeeded.
        said: What the dataset holds, in a sentence.
    """

    recordings: list[Path]
    dataset: Path
    successes: int
    said: str


def _silent(_outcome: Outcome) -> None:
    """Tell nobody."""


def make_set(
    folder: Path,
    episodes: int = EPISODES,
    *,
    first_seed: int = 0,
    view: str | None = None,
    on_outcome: Callable[[Outcome], None] = _silent,
    **settings: Any,
) -> DemonstrationSet:
    """Record an expert's insertions in scenes that differ, and write them as a dataset.

    Raises ConfigError if there is something in the folder, MissingPackageError if a package is not installed.

    Args:
        folder: A folder that is not there yet, or is empty; gets ``recordings`` and ``dataset``.
        first_seed: Seed of the first episode, which each next one's exceeds by one.
        view: Camera of a film, None for no film.
        on_outcome: Told each episode as it ends.
        settings: As for `rollouts`: jobs, scheduler, noise, and those of the environment.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f"{folder}: is there already")
    given = {"noise": TREMBLE, "randomise": dict(RANGES)} | settings
    successes = 0
    seeds = range(first_seed, first_seed + episodes)
    for outcome in rollouts(None, seeds, record=str(folder / "recordings"), **given):
        successes += outcome.success
        on_outcome(outcome)
    recordings = sorted((folder / "recordings").glob("*.mcap"))
    said = export_dataset(recordings, folder / "dataset", fps=FPS, view=view)
    return DemonstrationSet(recordings, folder / "dataset", successes, said)
