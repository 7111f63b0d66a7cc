"""A search for hands that get energy out: CMA-ES in the cube of `wall_hands.RANGES`, begun anew at random places.

Hansen, "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772, with the constants of its table 1 and no negative
weights. What leaves the cube is put back to its edge.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from trocar.services.mechanics.arrays import FloatArray

_STEP = 0.25
_SMALLEST_STEP = 1e-3


def search(
    value: Callable[[FloatArray], FloatArray],
    dimensions: int,
    generations: int,
    seed: int,
    size: int | None = None,
    *,
    is_found: Callable[[], bool] = lambda: False,
) -> tuple[FloatArray, FloatArray]:
    """Return all points (n, dimensions) that a search for the largest value has looked at, and their values (n,).

    Args:
        value: Of points (n, dimensions) in the unit cube: (n,).
        generations: At most; a search that has come to rest ends before.
        size: Points in a generation; none: 4 + 3 ln n, as the tutorial has it.
        is_found: Asked after each generation: whether what was sought has been seen, so that none has to follow.
    """
    random, n = np.random.default_rng(seed), dimensions
    size = size or 4 + int(3 * math.log(n))
    kept = size // 2
    weights = math.log(kept + 0.5) - np.log(np.arange(1, kept + 1))
    weights /= weights.sum()
    mass = 1.0 / np.sum(weights**2)
    c_sigma = (mass + 2.0) / (n + mass + 5.0)
    d_sigma = 1.0 + 2.0 * max(0.0, math.sqrt((mass - 1.0) / (n + 1.0)) - 1.0) + c_sigma
    c_path = (4.0 + mass / n) / (n + 4.0 + 2.0 * mass / n)
    c_one = 2.0 / ((n + 1.3) ** 2 + mass)
    c_rank = min(1.0 - c_one, 2.0 * (mass - 2.0 + 1.0 / mass) / ((n + 2.0) ** 2 + mass))
    expected = math.sqrt(n) * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n**2))
    mean, step, covariance = random.random(n), _STEP, np.eye(n)
    path, path_sigma = np.zeros(n), np.zeros(n)
    points, values = [], []
    for generation in range(generations):
        scales, axes = np.linalg.eigh(covariance)
        root = axes * np.sqrt(np.maximum(scales, 1e-14))
        batch = np.clip(mean + step * random.standard_normal((size, n)) @ root.T, 0.0, 1.0)
        found = value(batch)
        points.append(batch)
        values.append(found)
        if is_found():
            break
        best = batch[np.argsort(-found)[:kept]]
        moves = (best - mean) / step
        move = weights @ moves
        mean = mean + step * move
        whitened = axes @ ((axes.T @ move) / np.sqrt(np.maximum(scales, 1e-14)))
        path_sigma = (1.0 - c_sigma) * path_sigma + math.sqrt(c_sigma * (2.0 - c_sigma) * mass) * whitened
        length = float(np.linalg.norm(path_sigma))
        unbiased = length / math.sqrt(1.0 - (1.0 - c_sigma) ** (2 * (generation + 1)))
        settled = unbiased < (1.4 + 2.0 / (n + 1.0)) * expected
        path = (1.0 - c_path) * path + settled * math.sqrt(c_path * (2.0 - c_path) * mass) * move
        covariance = (1.0 - c_one - c_rank) * covariance + c_one * np.outer(path, path)
        covariance += c_rank * (moves.T * weights) @ moves
        step *= math.exp(c_sigma / d_sigma * (length / expected - 1.0))
        if step < _SMALLEST_STEP:
            break
    return np.concatenate(points), np.concatenate(values)
