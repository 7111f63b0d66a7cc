"""Many episodes at once: in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import gymnasium
import numpy as np

from trocar.envs.expert import Expert
from trocar.services.mechanics.arrays import Float32Array
from trocar.studies.accuracy.workers import open_workers

Policy = Callable[[Float32Array], Float32Array]
Settings = tuple[tuple[str, Any], ...]
Made = tuple[str, Settings]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one episode; ``processor_s`` is the time of the environment's steps, ``simulated_s`` its length."""

    seed: int
    success: bool
    steps: int
    reward: float
    cost_s: float
    depth_m: float
    simulated_s: float
    processor_s: float


def rollouts(
    policy: Policy | None,
    seeds: Sequence[int],
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    noise: float = 0.0,
    environment: str = "trocar/Insertion-v0",
    **settings: Any,
) -> Iterator[Outcome]:
    """Yield an outcome for each seed, in order of completion.

    Raises ConnectionError: there is no scheduler at that address.

    Args:
        policy: callable or None. Maps an observation to an action; None for the expert.
        jobs: int. Number of local processes.
        scheduler: str, optional. Address of a Dask scheduler, whose workers have this package; ``jobs`` has no effect.
        noise: float. Standard deviation of the noise added to each action, drawn from the episode's seed.
        environment: str. Name of the environment.
        settings: Arguments of the environment, such as those of `Insertion`.
    """
    with open_workers(jobs, scheduler) as workers:
        kept = tuple(sorted((name, _frozen(value)) for name, value in settings.items()))
        calls = [(policy, seed, noise, (environment, kept)) for seed in seeds]
        for _, outcome in workers.run(play, calls):
            yield outcome


def play(policy: Policy | None, seed: int, noise: float, made: Made) -> Outcome:
    """Run one episode and return its outcome."""
    env = _env(*made)
    random = np.random.default_rng(seed)
    observation, _ = env.reset(seed=seed)
    inside: Any = env.unwrapped
    expert = Expert(inside)
    steps, reward, cost_s, took_s, ended, info = 0, 0.0, 0.0, 0.0, False, {"is_success": False}
    while not ended:
        action = policy(observation) if policy is not None else expert.action()
        if noise:
            action = np.clip(action + random.normal(0.0, noise, action.shape), -1.0, 1.0).astype(np.float32)
        began_s = time.process_time()
        observation, gained, terminated, truncated, info = env.step(action)
        took_s += time.process_time() - began_s
        steps, reward, cost_s = steps + 1, reward + float(gained), cost_s + info["cost"]
        ended = terminated or truncated
    simulated_s, depth_m = inside.time_s, inside.depth_m
    inside.leave()
    return Outcome(seed, bool(info["is_success"]), steps, reward, cost_s, depth_m, simulated_s, took_s)


def _frozen(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(value)
    return tuple(sorted(value.items())) if isinstance(value, dict) else value


@cache
def _env(environment: str, settings: Settings) -> gymnasium.Env[Any, Any]:
    """Return an environment, cached for further episodes with these settings."""
    known: dict[str, Any] = {name: dict(value) if name == "randomise" else value for name, value in settings}
    return gymnasium.make(environment, **known)
