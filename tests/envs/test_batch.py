"""Scenes in batches: each does what one of its own does, to the bit, wherever it is stepped; and memory is shared."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator
from functools import cache
from typing import Any

import gymnasium
import numpy as np
import pytest
from distributed import LocalCluster

from tests.envs.walks import SMALL
from trocar.envs import Batch, Expert
from trocar.envs.ducts import Ducts
from trocar.services.runtime.errors import ConfigError

N, STEPS, SEED = 3, 120, 11
DRAWN = {"catheter.youngs_modulus_pa": (18e6, 60e6)}
INSERTION: dict[str, Any] = {"overrides": SMALL, "randomise": DRAWN}
NAVIGATION: dict[str, Any] = {"targets": ("right_upper", "left_lower"), "randomise": DRAWN}
KINDS = [("Insertion", INSERTION), ("Navigation", NAVIGATION)]
Played = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Observations (steps + 1, N, ...), rewards and actions (steps, N, ...)."""


@cache
def alone(kind: int) -> Played:
    """Return what single environments see and earn with an expert's hands that tremble, each made anew."""
    name, settings = KINDS[kind]
    played = []
    for k in range(N):
        env, random = gymnasium.make(f"trocar/{name}-v0", **settings), np.random.default_rng(k)
        seen: list[Any] = [env.reset(seed=SEED + k)[0]]
        rewards, actions, expert = [], [], Expert(env.unwrapped)  # type: ignore[arg-type]
        for _ in range(STEPS):
            action = np.clip(expert.action() + random.normal(0.0, 0.05, env.action_space.shape), -1.0, 1.0)  # type: ignore[arg-type]
            actions.append(action.astype(np.float32))
            observation, reward, *_ = env.step(actions[-1])
            seen.append(observation)
            rewards.append(reward)
        assert np.any(env.unwrapped.simulation.contact_force_n), "nothing is touched"  # type: ignore[attr-defined]
        env.close()
        played.append((seen, rewards, actions))
    return tuple(np.swapaxes(np.array([each[part] for each in played]), 0, 1) for part in range(3))  # type: ignore[return-value]


def check(batch: Batch, kind: int) -> None:
    """Compare a batch, and once more after a reset of all, with single environments."""
    observations, rewards, actions = alone(kind)
    for _ in range(2):
        np.testing.assert_array_equal(batch.reset(seed=SEED)[0], observations[0])
        for k in range(STEPS):
            seen, earned, *_ = batch.step(actions[k])
            np.testing.assert_array_equal(seen, observations[k + 1])
            np.testing.assert_array_equal(earned, rewards[k])


@pytest.mark.parametrize("kind", range(len(KINDS)), ids=[name for name, _ in KINDS])
def test_each_scene_of_a_batch_is_one_of_its_own_to_the_bit(kind: int) -> None:
    name, settings = KINDS[kind]
    batch = gymnasium.make_vec(f"trocar/{name}-v0", N, vectorization_mode="vector_entry_point", **settings)
    check(batch, kind)  # type: ignore[arg-type]
    batch.close()
    assert len({each.tobytes() for each in alone(kind)[0][-1]}) == N, "scenes that are alike show nothing"


@pytest.mark.parametrize("place", ["processes", "cluster"])
def test_scenes_elsewhere_are_the_same_to_the_bit(place: str) -> None:
    if place == "processes":
        batch = Batch("trocar/Insertion-v0", N, jobs=2, **INSERTION)
        check(batch, 0)
        batch.close()
        return
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster:
        batch = Batch("trocar/Insertion-v0", N, scheduler=cluster.scheduler_address, **INSERTION)
        check(batch, 0)
        batch.close()


@pytest.fixture(scope="module")
def batch() -> Iterator[Batch]:
    made = Batch("trocar/Insertion-v0", 2, overrides=SMALL, max_episode_steps=4)
    yield made
    made.close()


def test_scenes_share_their_duct_and_the_cache_of_its_residual(batch: Batch) -> None:
    first, second = batch.call("simulation")
    assert first.duct.reduced.basis is second.duct.reduced.basis
    assert first.duct.reduced.rows is second.duct.reduced.rows
    assert first.duct.state.q is not second.duct.state.q


def test_without_a_batch_scenes_share_only_what_no_step_writes_to() -> None:
    """Threads may step environments that know nothing of each other."""
    envs = [gymnasium.make("trocar/Insertion-v0", overrides=SMALL) for _ in range(2)]
    first, second = (env.unwrapped.simulation.duct.reduced for env in envs)  # type: ignore[attr-defined]
    assert first.basis is second.basis
    assert first.rows is None
    assert second.rows is None


def test_ducts_that_nobody_uses_are_forgotten_and_are_not_copied_with_arguments() -> None:
    ducts = Ducts()
    env = gymnasium.make("trocar/Insertion-v0", overrides=SMALL, ducts=ducts)
    assert env.spec is not None
    assert env.spec.kwargs["ducts"] is ducts
    assert len(ducts) == 1
    env.close()
    del env
    gc.collect()
    assert len(ducts) == 0


def test_an_episode_that_ended_begins_again_as_the_mode_says(batch: Batch) -> None:
    batch.reset(seed=1)
    zero = np.zeros((2, *batch.single_action_space.shape), np.float32)  # type: ignore[misc]
    start, _ = batch.reset(seed=1)
    for _ in range(3):
        *_, truncated, _ = batch.step(zero)
        assert not truncated.any()
    *_, truncated, infos = batch.step(zero)
    assert truncated.all()
    assert infos["_depth_m"].all()
    again, rewards, _, truncated, infos = batch.step(zero)
    assert not truncated.any()
    assert not rewards.any()
    np.testing.assert_array_equal(again, start)


def test_in_the_same_step_and_by_a_mask() -> None:
    made = Batch("trocar/Insertion-v0", 2, overrides=SMALL, max_episode_steps=2, autoreset_mode="SameStep")
    zero = np.zeros((2, *made.single_action_space.shape), np.float32)  # type: ignore[misc]
    start, _ = made.reset(seed=1)
    made.step(zero)
    made.reset(options={"reset_mask": np.array([False, True])})
    observations, _, _, truncated, infos = made.step(zero)
    assert truncated.tolist() == [True, False]
    np.testing.assert_array_equal(observations[0], start[0])
    assert not np.array_equal(infos["final_obs"][0], start[0])
    assert infos["_final_info"].tolist() == [True, False]
    made.close()


def test_a_process_that_dies_is_told_in_a_sentence_and_the_batch_closes() -> None:
    made = Batch("trocar/Insertion-v0", 2, jobs=2, overrides=SMALL)
    made.reset(seed=1)
    os.kill(made._groups[1]._process.pid, signal.SIGKILL)  # type: ignore[attr-defined]
    with pytest.raises(ConnectionError, match="a process of scenes has ended, with exit code -9"):
        made.step(np.zeros((2, *made.single_action_space.shape), np.float32))  # type: ignore[misc]
    made.close()


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_a_scene_refuses_is_refused_and_the_batch_goes_on(jobs: int) -> None:
    made = Batch("trocar/Insertion-v0", 2, jobs=jobs, overrides=SMALL)
    made.reset(seed=1)
    bad = np.zeros((2, *made.single_action_space.shape), np.float32)  # type: ignore[misc]
    bad[1, 0, 0] = np.nan
    for wrong in (bad, np.zeros((1, 2)), bad[:1]):
        with pytest.raises(ValueError, match=r"not a finite number|their shape is"):
            made.step(wrong)
    assert made.call("time_s") == (0.0, 0.0), "nothing has moved"
    assert np.isfinite(made.step(np.zeros_like(bad))[0]).all()
    made.close()
    made.close()
    with pytest.raises(ConfigError, match="step: the batch is closed"):
        made.step(made.action_space.sample())
    with pytest.raises(ConfigError, match="reset: the batch is closed"):
        made.reset()


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"num_envs": 0}, "num_envs: must be a whole number from 1 on, is 0"),
        ({"num_envs": 2, "jobs": 0}, "jobs: must be a whole number"),
        ({"num_envs": 2, "scenario": "none such"}, "none such"),
        ({"num_envs": 2, "jobs": 2, "scenario": "none such"}, "none such"),
    ],
)
def test_an_argument_that_cannot_be_used_is_told_in_a_sentence(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        Batch("trocar/Insertion-v0", **settings)


def test_a_scheduler_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    from trocar.studies.accuracy import workers

    monkeypatch.setattr(workers, "CONNECT_S", 0.3)
    with pytest.raises(ConnectionError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        Batch("trocar/Insertion-v0", 2, scheduler="tcp://127.0.0.1:9")
