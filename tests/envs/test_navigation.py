"""The way to a branch as an environment: seeds, what is drawn, and who gets there."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trocar
from trocar.envs import Expert, Insertion, Navigation, navigation_state
from trocar.envs.cloning import clone, read_demonstrations
from trocar.envs.navigation import PUSH, STEER, TWIST, travel_m
from trocar.envs.rollouts import rollouts
from trocar.envs.state import places
from trocar.review.attempts.recorded import assess_file
from trocar.services.cli.rerun import compare
from trocar.services.recordings.inputs import read_inputs
from trocar.services.training.score import load_rules

BRONCHI = ("right_upper", "right_lower", "left_upper", "left_lower")
VESSELS = ("subclavian", "carotid", "brachiocephalic")
ENDS = [*(("bronchoscopy", each) for each in BRONCHI), *(("endovascular", each) for each in VESSELS)]


@pytest.fixture(scope="module")
def env() -> Iterator[Navigation]:
    made = Navigation()
    yield made
    made.close()


def test_targets_are_drawn_by_the_seed_and_each_has_its_own_goal() -> None:
    made = Navigation(targets=BRONCHI)
    drawn = {}
    for seed in range(12):
        _, info = made.reset(seed=seed)
        drawn[info["target"]] = made.scenario.goal
        assert made.simulation.scene.target == made.scenario.goal.branch == info["target"]
        assert made.reset(seed=seed)[1]["target"] == info["target"]
    assert drawn.keys() == set(BRONCHI)
    assert drawn["left_lower"] == Navigation().scenario.goal
    assert len({goal.depth_m for goal in drawn.values()}) > 1


def test_an_action_pushes_along_the_catheter_twists_and_steers(env: Navigation) -> None:
    env.reset(seed=0)
    at = places(navigation_state.FIELDS)
    began = env.hands.state.copy()
    for column in (PUSH, TWIST, STEER):
        action = np.zeros(3, np.float32)
        action[column] = 0.5
        for _ in range(5):
            seen, *_ = env.step(action)
    moved = (env.hands.state - began)[0]
    along = np.array(env.simulation.scene.catheter.direction)
    np.testing.assert_allclose(moved[:3], 0.05 * 0.5 * 0.1 * along, atol=1e-9)
    np.testing.assert_allclose(moved[3:], (4.0 * 0.5 * 0.1, 3.0 * 0.5 * 0.1), rtol=1e-9)
    assert seen[at["pushed"]] == pytest.approx(2.5e-3, abs=1e-7)
    np.testing.assert_allclose(seen[at["twist"]], (np.sin(0.2), np.cos(0.2)), atol=1e-6)
    assert seen[at["handle"]] == pytest.approx(0.15)


def test_the_drive_stops_where_the_catheter_would_leave_its_introducer(env: Navigation) -> None:
    env.reset(seed=0)
    began = env.hands.state[0, :3].copy()
    env.hands.steer(env._rates_of(np.array([-1.0, 0.0, 0.0])))
    env.hands.move(1.0)
    np.testing.assert_allclose(env.hands.state[0, :3], began, atol=1e-12)
    env.hands.steer(env._rates_of(np.array([1.0, 1.0, 0.0])))
    env.hands.move(60.0)
    catheter = env.simulation.scene.catheter
    assert np.linalg.norm(env.hands.state[0, :3] - began) == pytest.approx(travel_m(catheter))
    assert travel_m(catheter) == pytest.approx(0.155)
    assert env.hands.state[0, 3] == pytest.approx(240.0)


def test_what_is_seen_is_where_things_are(env: Navigation) -> None:
    seen, _ = env.reset(seed=0)
    at = places(navigation_state.FIELDS)
    assert seen.shape == env.observation_space.shape
    tip_m, mouth_m = env.simulation.catheter.state.position_m[-1], np.array(env._stage.site.mouth_m)
    np.testing.assert_allclose(seen[at["catheter"]][:3], tip_m - mouth_m, atol=1e-7)
    np.testing.assert_allclose(seen[at["ahead"]][:3], mouth_m - tip_m, atol=1e-6)
    assert seen[at["to_go"]] == pytest.approx(env.scenario.goal.depth_m)


def test_a_wrong_branch_costs_what_was_won_and_drawing_back_wins_it_again() -> None:
    made = Navigation("endovascular", targets=["brachiocephalic"])
    made.reset(seed=0)
    way, rewards = [], []
    for _ in range(64):
        seen, reward, *_ = made.step(np.array([1.0, 0.0, 0.0], np.float32))
        way.append(made._way_m())
        rewards.append(reward)
    assert seen[places(navigation_state.FIELDS)["astray"]] > 10e-3
    assert np.max(way) - way[-1] > 10e-3
    assert sum(rewards[np.argmax(way) + 1 :]) < -0.1
    back = [made.step(np.array([-1.0, 0.0, 0.0], np.float32))[1] for _ in range(30)]
    assert np.cumsum(back).max() > 0.1


@pytest.mark.parametrize(
    ("kind", "settings", "said"),
    [
        (Navigation, {"targets": ["middle"]}, "goal.branch: the duct has no end 'middle'; it has: "),
        (Navigation, {"scenario": "basic"}, "scenario basic: its goal is no branch"),
        (Navigation, {"observation": "image", "targets": BRONCHI}, "targets: an image does not show which"),
        (Insertion, {"scenario": "bronchoscopy"}, "a drive moves its catheter, see trocar/Navigation-v0"),
    ],
)
def test_what_cannot_be_done_is_refused_in_a_sentence(kind: type[Any], settings: Any, said: str) -> None:
    with pytest.raises(trocar.ConfigError, match=said):
        kind(**settings)


def test_an_image_is_the_view_as_by_x_rays() -> None:
    made = Navigation("endovascular", "image", image_size=(64, 48), render_mode="rgb_array")
    first, _ = made.reset(seed=0)
    expert = Expert(made)
    for _ in range(120):
        image, *_ = made.step(expert.action())
    assert first.shape == (48, 64, 3) == made.render().shape
    changed = np.abs(image.astype(int) - first).max(axis=2) > 60
    assert 10 < changed.sum() < 200
    assert image[changed].mean() < first[changed].mean() - 60.0
    made.close()


def test_an_experts_episode_succeeds_and_its_recording_is_judged_and_run_again_alike(tmp_path: Path) -> None:
    made = Navigation("endovascular", targets=["carotid"], record=tmp_path)
    seen, did = [made.reset(seed=0)[0]], []
    expert, done, info = Expert(made, effort=0.8), False, {}
    while not done:
        did.append(expert.action())
        observation, _, done, _, info = made.step(did[-1])
        seen.append(observation)
    made.leave()
    (path,) = tmp_path.glob("*.mcap")
    (found,) = assess_file(path, load_rules())
    assert info["is_success"]
    assert found.outcome == info["outcome"] == "success"
    assert (found.time_s, found.score.total) == (info["time_s"], info["score"])
    again = compare(read_inputs(path))
    assert again.compared > 200
    assert again.alike == again.compared, again.first_difference
    observations, actions = read_demonstrations([path], env=made)
    np.testing.assert_array_equal(observations.astype(np.float32), np.array(seen)[:-1])
    np.testing.assert_allclose(actions, np.array(did), atol=1e-6)
    assert clone(observations, actions)(seen[0]).shape == (3,)


@pytest.mark.long
@pytest.mark.parametrize(("scenario", "target"), ENDS)
def test_trembling_experts_reach_every_branch_where_stiffness_and_friction_differ(scenario: str, target: str) -> None:
    keys = ("catheter.youngs_modulus_pa", "catheter.sections.0.youngs_modulus_pa")
    ends = {"bronchoscopy": ((15e6, 25e6), (6e6, 10e6)), "endovascular": ((22e6, 38e6), (8e6, 12e6))}[scenario]
    ranges = dict(zip(keys, ends, strict=True))
    ranges |= {"catheter.before_mouth_m": (3e-3, 6e-3), "effects.friction.mu_kinetic": (0.02, 0.05)}
    settings: dict[str, Any] = {"scenario": scenario, "targets": (target,), "randomise": ranges}
    found = list(rollouts(None, range(6), noise=0.1, environment="trocar/Navigation-v0", **settings))
    assert sum(each.success for each in found) >= 5
