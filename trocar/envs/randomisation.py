"""Domain randomisation: keys of a scene that are drawn for each episode, with their ranges."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_scene

Bound = int | float


class Randomisation:
    """Ranges of keys of a scene file, named as for ``--set``, with uniform distribution including both ends.

    Two whole numbers are a range of whole numbers. Every end, and all lower and all upper ends together, are validated
    by the scene's model at construction. Raises ConfigError: one sentence that names the key, if a range or an end is
    invalid.

    Args:
        scene: str or Path. As for `trocar.load_scene`.
        ranges: mapping. Key to (lowest, highest), as ``{"catheter.youngs_modulus_pa": (20e6, 60e6), "duct.n_modes":
            (40, 60)}``.
        overrides: tuple of str. Overrides that are applied first.
    """

    def __init__(
        self, scene: str | Path, ranges: Mapping[str, tuple[Bound, Bound]], overrides: tuple[str, ...] = ()
    ) -> None:
        self.ranges = {key: _checked(key, ends) for key, ends in ranges.items()}
        for key, ends in self.ranges.items():
            for end in ends:
                _try(scene, (*overrides, _override(key, end)), f"randomise: {key}: {end:g} cannot be used")
        for at, name in enumerate(("lower", "upper")):
            together = tuple(_override(key, ends[at]) for key, ends in self.ranges.items())
            _try(scene, (*overrides, *together), f"randomise: all {name} ends together cannot be used")

    def draw(self, random: np.random.Generator) -> dict[str, Bound]:
        """Return a value for each key, in the order of declaration."""
        drawn: dict[str, Bound] = {}
        for key, (low, high) in self.ranges.items():
            if isinstance(low, int) and isinstance(high, int):
                drawn[key] = int(random.integers(low, high, endpoint=True))
            else:
                drawn[key] = float(random.uniform(low, high))
        return drawn

    @staticmethod
    def overrides(drawn: Mapping[str, Bound]) -> tuple[str, ...]:
        """Return drawn values as overrides of a scene."""
        return tuple(_override(key, value) for key, value in drawn.items())


def _checked(key: str, ends: tuple[Bound, Bound]) -> tuple[Bound, Bound]:
    numbers = isinstance(ends, list | tuple) and all(type(end) in (int, float) and math.isfinite(end) for end in ends)
    if not numbers or len(ends) != 2 or not ends[0] <= ends[1]:
        raise ConfigError(f"randomise: {key}: must be two numbers, the lower first, is {ends!r}")
    return ends[0], ends[1]


def _override(key: str, value: Bound) -> str:
    return f"{key}={value!r}"


def _try(scene: str | Path, overrides: tuple[str, ...], what: str) -> None:
    try:
        load_scene(scene, overrides)
    except ConfigError as error:
        raise ConfigError(f"{what}: {error}") from None
