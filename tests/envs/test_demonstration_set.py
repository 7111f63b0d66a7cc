"""A set of demonstrations made by one call: cloning from its dataset equals cloning from its recordings."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tests.envs.walks import SMALL
from trocar.envs.cloning import ClonedPolicy, clone, read_demonstrations
from trocar.envs.demonstration_set import EPISODES, RANGES, DemonstrationSet, make_set
from trocar.envs.lerobot import read_dataset
from trocar.envs.rollouts import Outcome, rollouts
from trocar.services.runtime.errors import ConfigError


def clones(made: DemonstrationSet) -> tuple[ClonedPolicy, ClonedPolicy]:
    return clone(*read_dataset(made.dataset)), clone(*read_demonstrations(made.recordings))


def assert_equal(one: ClonedPolicy, other: ClonedPolicy) -> None:
    for field in dataclasses.fields(ClonedPolicy):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


def test_cloning_from_the_dataset_equals_cloning_from_the_recordings_to_the_bit(tmp_path: Path) -> None:
    told: list[Outcome] = []
    made = make_set(tmp_path / "set", 2, overrides=SMALL, on_outcome=told.append)
    assert len(made.recordings) == 2
    assert made.successes == 2
    assert sorted(each.seed for each in told) == [0, 1]
    assert_equal(*clones(made))
    with pytest.raises(ConfigError, match="set: is there already"):
        make_set(tmp_path / "set", 2, overrides=SMALL)


def test_what_is_no_dataset_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"holds no dataset of LeRobot 3\.0"):
        read_dataset(tmp_path)
    (tmp_path / "data" / "chunk-000").mkdir(parents=True)
    (tmp_path / "data" / "chunk-000" / "file-000.parquet").write_bytes(b"PAR1 no PAR1")
    with pytest.raises(ConfigError, match="is no dataset of an insertion"):
        read_dataset(tmp_path)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_the_whole_set_is_cloned_to_a_policy_that_succeeds_as_often(tmp_path: Path) -> None:
    made = make_set(tmp_path / "set", overrides=SMALL)
    assert made.successes == EPISODES
    one, other = clones(made)
    assert_equal(one, other)
    seen = {"overrides": SMALL, "randomise": dict(RANGES), "max_episode_steps": 400}
    reached = list(rollouts(one, range(1000, 1018), **seen))
    print(f"{sum(each.success for each in reached)} of {len(reached)} succeed")
    assert sum(each.success for each in reached) >= 16
