"""Random steps of an environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

SMALL = ("duct.n_around=20", "duct.n_along=26", "duct.n_modes=40")


def walk(env: gymnasium.Env[Any, Any], n: int = 12, seed: int = 3) -> np.ndarray:
    """Return what is seen at first and after each of `n` steps, whose actions are always the same."""
    actions = np.random.default_rng(5).uniform(-1.0, 1.0, (n, *env.action_space.shape)).astype(np.float32)
    seen = [env.reset(seed=seed)[0]]
    seen += [env.step(action)[0] for action in actions]
    return np.array(seen)
