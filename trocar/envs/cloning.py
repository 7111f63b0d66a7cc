"""Behaviour cloning: a policy fitted in closed form to recorded hands.

Ridge regression on random Fourier features (Rahimi and Recht, Random Features for Large-Scale Kernel Machines,
NIPS 2007) of the observation, scaled to unit spread.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from trocar.envs.episode import FAST
from trocar.envs.hands import HandLimits
from trocar.envs.state import StateView, View
from trocar.protocol.topics import TICK_S
from trocar.services.mechanics.arrays import Float32Array, FloatArray
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.reader import read_arrays, read_moments
from trocar.services.training.site import read_site

if TYPE_CHECKING:
    from trocar.envs.task import Task

N_FEATURES = 600
WIDTH = 4.0
"""Width of the kernel, in spreads of the observation."""
RIDGE = 1.0
"""As of features of spread 1: bears hands that tremble. With a thousandth of it a policy repeats the tremble of its
demonstrations, and none of three episodes succeeds after four of them; from a tenth to ten times of it all do.
"""
_SMALLEST = 1e-6


@dataclass(frozen=True, slots=True)
class ClonedPolicy:
    """Maps an observation (s,) to an action of ``shape``: picklable, without randomness.

    Actions are limited to the demonstrated range: far from the demonstrations a fitted function is arbitrary, and fast
    hits on tissue also cost the simulation most.
    """

    middle: FloatArray
    spread: FloatArray
    frequencies: FloatArray
    phases: FloatArray
    weights: FloatArray
    least: FloatArray
    most: FloatArray
    shape: tuple[int, ...]

    def __call__(self, observation: Float32Array) -> Float32Array:
        """Return the action."""
        action = _features((observation - self.middle) / self.spread, self.frequencies, self.phases) @ self.weights
        return np.clip(action, self.least, self.most).astype(np.float32).reshape(self.shape)


def clone(observations: FloatArray, actions: FloatArray, seed: int = 0) -> ClonedPolicy:
    """Return the policy that imitates the demonstrations.

    Args:
        observations: (n, s) array
        actions: (n, ...) array. Rounded to single precision, in which an environment takes them and datasets keep them.
        seed: int. Seed of the random features.
    """
    random = np.random.default_rng(seed)
    middle, spread = observations.mean(axis=0), observations.std(axis=0)
    spread = np.where(spread > _SMALLEST, spread, np.inf)  # ignores constant components
    frequencies = random.normal(0.0, 1.0 / WIDTH, (observations.shape[1], N_FEATURES))
    phases = random.uniform(0.0, 2.0 * np.pi, N_FEATURES)
    flat = actions.reshape(len(actions), -1).astype(np.float32).astype(np.float64)
    features = _features((observations - middle) / spread, frequencies, phases)
    normal = features.T @ features + RIDGE * len(features) / N_FEATURES * np.eye(features.shape[1])
    weights = cho_solve(cho_factor(normal), features.T @ flat)
    least, most = flat.min(axis=0), flat.max(axis=0)
    return ClonedPolicy(middle, spread, frequencies, phases, weights, least, most, actions.shape[1:])


def read_demonstrations(
    paths: Iterable[Path], limits: HandLimits | None = None, env: Task | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return observations (n, s) and actions (n, ...) of recorded episodes.

    Raises RecordingError or ValueError: a file is no recording, or has no duct.

    Args:
        limits: Limits of the hands of an insertion.
        env: ``env.unwrapped`` of the recorded environment, after a reset, with the recordings' duct. None for
            insertions in any duct.
    """
    if env is not None:
        parts = [_read(path, env.view, env.hands.limits.rates) for path in paths]
        return _joined([(seen, np.stack([env.action_of(each) for each in done])) for seen, done in parts])
    view_of, rates = cache(_view), (limits or HandLimits()).rates
    return _joined([_read(path, view_of(_duct_file(path)), rates) for path in paths])


def _joined(parts: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    return np.concatenate([each[0] for each in parts]), np.concatenate([each[1] for each in parts])


def _duct_file(path: Path) -> bytes:
    found = read_arrays(path, "duct.npz")
    if found is None:
        raise RecordingError(f"{path}: its duct is not in it")
    return found


def _view(duct_file: bytes) -> StateView:
    return StateView(read_site(duct_file), duct_file)


def _read(path: Path, view: View, fastest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the observation of each moment, and the hands' velocity towards the next."""
    observations, states, times_s = [], [], []
    for devices, contacts, solved in read_moments(path, FAST):
        observations.append(view.read(devices, contacts, solved))
        states.append([(*each.position_m, each.roll_rad, each.handle_angle_rad) for each in devices.instruments])
        times_s.append(solved.tick * TICK_S)
    rates = np.diff(np.array(states), axis=0) / np.diff(times_s)[:, None, None]
    return np.array(observations, np.float64)[:-1], rates / fastest


def _features(scaled: FloatArray, frequencies: FloatArray, phases: FloatArray) -> FloatArray:
    waves = np.sqrt(2.0 / len(phases)) * np.cos(scaled @ frequencies + phases)
    ones = np.ones((*scaled.shape[:-1], 1))
    features: FloatArray = np.concatenate([waves, scaled, ones], axis=-1)
    return features
