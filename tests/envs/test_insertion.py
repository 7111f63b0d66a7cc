"""The insertion as an environment: seeds, what is drawn, the procedure's verdict, and its recording."""

from __future__ import annotations

import gc
import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import trocar
from tests.by_day import by_day
from tests.envs.walks import SMALL, walk
from trocar.envs import Expert, Insertion, state
from trocar.envs.cloning import read_demonstrations
from trocar.envs.rollouts import rollouts
from trocar.review.attempts.recorded import assess_file
from trocar.services.cli.rerun import compare
from trocar.services.mechanics.scene.tools import ToolInputs
from trocar.services.recordings.inputs import read_inputs
from trocar.services.training.score import load_rules

RANGES = {"catheter.youngs_modulus_pa": (30e6, 60e6), "catheter.n_segments": (38, 42)}


@pytest.fixture(scope="module")
def env() -> Iterator[Insertion]:
    made = Insertion(overrides=SMALL)
    yield made
    made.close()


def test_without_randomisation_it_is_the_plain_simulation_to_the_bit(env: Insertion) -> None:
    """But for the stiffness that hands would meet, which nobody asks for."""
    env.reset(seed=0)
    scene = trocar.load_scene("default", SMALL)
    plain = trocar.simulate(scene)
    plain.set_quality(len(scene.quality) - 1)
    expert = Expert(env)
    for _ in range(100):
        action = expert.action()
        hands = type(env.hands)(scene.forceps, env.hands.limits, np.array(env.hands.middle_m))
        hands.state[:] = env.hands.state
        env.step(action)
        hands.steer(action.astype(float))
        for _ in range(10):
            hands.move(2e-3)
            plain.step(hands.inputs, 2e-3)
    np.testing.assert_array_equal(plain.catheter.state.position_m, env.simulation.catheter.state.position_m)
    np.testing.assert_array_equal(plain.duct.state.q, env.simulation.duct.state.q)
    assert plain.tool_results.stiffness_n_m.any()
    assert not env.simulation.tool_results.stiffness_n_m.any()


def test_what_is_drawn_lies_within_its_range_and_is_in_the_scene() -> None:
    made = Insertion(overrides=SMALL, randomise=RANGES)
    drawn = [made.reset(seed=seed)[1]["drawn"] for seed in range(6)]
    for key, (low, high) in RANGES.items():
        values = [each[key] for each in drawn]
        assert all(low <= value <= high for value in values)
        assert len(set(values)) > 1
    last = made.simulation.scene.catheter
    assert (last.youngs_modulus_pa, last.n_segments) == tuple(drawn[-1].values())


@pytest.mark.parametrize(
    ("ranges", "said"),
    [
        ({"catheter.stiffness": (1.0, 2.0)}, "randomise: catheter.stiffness: 1 cannot be used: .*unknown key"),
        ({"catheter.youngs_modulus_pa": (-1.0, 2e6)}, "randomise: catheter.youngs_modulus_pa: -1 .*must be positive"),
        ({"duct.radius_m": (5e-3, 4e-3)}, "randomise: duct.radius_m: must be two numbers, the lower first"),
        ({"duct.radius_m": (4e-3, float("nan"))}, "randomise: duct.radius_m: must be two numbers"),
        ({"duct.radius_m": 4e-3}, "randomise: duct.radius_m: must be two numbers"),
    ],
)
def test_a_bad_range_is_refused_in_a_sentence(ranges: Any, said: str) -> None:
    with pytest.raises(trocar.ConfigError, match=said):
        Insertion(overrides=SMALL, randomise=ranges)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"observation": "sound"}, "observation: must be state or image, is 'sound'"),
        ({"step_s": 0.05}, "step_s: must be a multiple of 4 ms up to 40, is 0.05 s"),
        ({"quality": 7}, "quality: scene default has rungs 0 to 1, not 7"),
        ({"scenario": "basik"}, "there is no scenario 'basik'"),
    ],
)
def test_a_bad_setting_is_refused_in_a_sentence(settings: Any, said: str) -> None:
    with pytest.raises(trocar.ConfigError, match=said):
        Insertion(overrides=SMALL, **settings)


def test_an_experts_episode_succeeds_and_its_recording_is_judged_and_run_again_alike(tmp_path: Path) -> None:
    made = Insertion(overrides=SMALL, record=tmp_path)
    seen = [made.reset(seed=0)[0]]
    expert, cost_s, done, info = Expert(made), 0.0, False, {}
    did = []
    while not done:
        did.append(expert.action())
        observation, _, done, _, info = made.step(did[-1])
        seen.append(observation)
        cost_s += info["cost"]
    made.leave()
    (path,) = tmp_path.glob("*.mcap")
    (found,) = assess_file(path, load_rules())
    assert info["is_success"]
    assert found.outcome == info["outcome"] == "success"
    assert found.score is not None
    assert found.time_s == info["time_s"]
    assert (found.score.total, found.score.penalties_s) == (info["score"], cost_s)
    assert {event.code: 1 for event in found.errors}.keys() == info["errors"].keys()
    again = compare(read_inputs(path))
    assert again.compared >= 2 * len(did)
    assert again.alike == again.compared, again.first_difference
    observations, actions = read_demonstrations([path])
    np.testing.assert_array_equal(observations.astype(np.float32), np.array(seen)[:-1])
    np.testing.assert_allclose(actions, np.array(did), atol=1e-6)


@pytest.mark.parametrize("seed", by_day((0, 1), range(2, 12)))
def test_jaws_that_open_and_close_on_a_catheter_that_moves_hold_it_where_haptics_would(
    tmp_path: Path, seed: int
) -> None:
    """Seed 1 closes on the tip: what is held there must be on the catheter, or physics refuses the tools."""
    made, random = Insertion(overrides=SMALL, record=tmp_path), np.random.default_rng(seed)
    made.reset(seed=0)
    script, asked, length, held = trocar.expert(made.simulation), ToolInputs(), random.integers(6, 14), set()
    for k in range(110):
        script.write_inputs(min(made.time_s + made.step_s, script.duration_s), asked)
        way = made.hands.state_of(asked) - made.hands.state
        action = way / (made.step_s * made.hands.limits.rates) + random.normal(0.0, 0.1, (2, 5))
        if k > 25:
            action[:, 4] = 1.0 if (k - 26) // length % 2 == 0 else -1.0
        made.step(np.clip(action, -1.0, 1.0))
        held |= {hold.hold_id for hold in made.held}
    made.close()
    assert len(held) > 4
    (path,) = tmp_path.glob("*.mcap")
    again = compare(read_inputs(path))
    assert again.compared > 200
    assert again.alike == again.compared, again.first_difference


def test_an_episode_that_is_left_is_judged_as_abandoned(tmp_path: Path) -> None:
    made = Insertion(overrides=SMALL, record=tmp_path)
    walk(made, 40)
    made.close()
    (path,) = tmp_path.glob("*.mcap")
    assert [each.outcome for each in assess_file(path, load_rules())] == ["abandoned"]


def test_an_observation_is_its_fields_one_after_the_other(env: Insertion) -> None:
    observation, _ = env.reset(seed=0)
    places = state.places()
    assert observation.shape == (state.SIZE,) == env.observation_space.shape
    tip_m = env.simulation.catheter.state.position_m[-1] - np.array(env.hands.middle_m)
    np.testing.assert_allclose(observation[places["catheter"]][:3], tip_m, atol=1e-7)
    assert observation[places["time"]] == 0.0


def test_an_image_shows_the_scene() -> None:
    made = Insertion(overrides=SMALL, observation="image", image_size=(64, 48), render_mode="rgb_array")
    first, _ = made.reset(seed=0)
    assert first.shape == (48, 64, 3) == made.render().shape
    assert first.std() > 10.0
    made.close()


def test_processes_of_gymnasium_step_as_one_does(env: Insertion) -> None:
    vector = gymnasium.make_vec("trocar/Insertion-v0", 2, "async", overrides=SMALL)
    actions = np.full((2, *env.action_space.shape), 0.3, np.float32)
    seen = [vector.reset(seed=[3, 4])[0]] + [vector.step(actions)[0] for _ in range(3)]
    vector.close()
    alone = [env.reset(seed=3)[0]] + [env.step(actions[0])[0] for _ in range(3)]
    np.testing.assert_array_equal(np.array(seen)[:, 0], alone)


def test_a_cluster_plays_the_same_episodes_as_this_process() -> None:
    from distributed import LocalCluster

    settings = {"overrides": SMALL, "randomise": RANGES, "max_episode_steps": 80}
    here = {each.seed: each for each in rollouts(_still, range(2), **settings)}
    assert here[0].reward != here[1].reward, "what is drawn differs, and is seen"
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster:
        there = {
            each.seed: each for each in rollouts(_still, range(2), scheduler=cluster.scheduler_address, **settings)
        }
    assert {seed: (each.reward, each.steps) for seed, each in there.items()} == {
        seed: (each.reward, each.steps) for seed, each in here.items()
    }


def _still(observation: np.ndarray) -> np.ndarray:
    return np.full((2, 5), 0.01, np.float32)


def test_closing_leaves_nothing_behind(tmp_path: Path) -> None:
    """But for the duct that was used last, whose residual compliance stays mapped."""
    left = set()
    for _ in range(3):
        made = Insertion(overrides=SMALL, record=tmp_path)
        walk(made, 2)
        made.close()
        gc.collect()
        left.add((threading.active_count(), len(os.listdir("/proc/self/fd"))))
    assert len(left) == 1


def test_trocar_does_without_gymnasium_whose_makers_find_its_environments_once_they_are_imported() -> None:
    """In a fresh process, as the page says; by the name of the module in front it is `test_examples.py`'s."""
    text = """
import sys, trocar
assert 'gymnasium' not in sys.modules
sys.modules['gymnasium'] = None
try:
    import trocar.envs
except ModuleNotFoundError as error:
    print(error)
for name in [each for each in sys.modules if each == 'gymnasium' or each.startswith('trocar.envs')]:
    del sys.modules[name]
import trocar.envs, gymnasium
gymnasium.make('trocar/Insertion-v0', scenario='nowhere')
"""
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    assert done.stdout.startswith("trocar.envs needs the package 'gymnasium': ")
    (wanted,) = re.findall(r"-m pip install 'gymnasium([^']*)'", done.stdout)
    assert sorted(wanted.split(",")) == ["<2", ">=1.4"]
    assert "ConfigError: there is no scenario 'nowhere'" in done.stderr
