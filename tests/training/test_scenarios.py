"""Scenario files: each is what it says, is refused with a sentence, and simulated hands do it within its par."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from tests.refusals import assert_refused
from tests.training.hands_attempt import attempt_of_hands
from tests.training.simulated import patient
from trocar.services.cli.attempt import made_of
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import load_scene
from trocar.services.training.scenario import ASSUMPTION, LIMITS, load_scenario, scenario_names, scenario_of

__all__ = ["patient"]

NAMES = [
    "basic",
    "bronchoscopy",
    "cholangiography",
    "endovascular",
    "guide-wire",
    "mirrored",
    "narrow",
    "one-handed",
    "stone",
    "weak-wall",
]
#: What is said of simulated hands besides the time: of the one that takes the catheter, of the tip and of the tissues.
PAR = (
    "time_s", "errors", "grasps", "retries", "tip.path_m", "tool_duct.peak_n", "tool_catheter.peak_n",
    "catheter_wall.peak_n",
)  # fmt: skip


def test_there_are_the_ten() -> None:
    assert scenario_names() == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_each_loads_and_its_scene_with_it_and_every_limit_has_a_source(name: str) -> None:
    scenario = load_scenario(name)
    scene, overrides = made_of(name, None, ("gateway.force_limit_n=2",))
    load_scene(scene, config.split_overrides(overrides)[1])
    assert config.load_rig("stub", overrides).training.scenario == name
    assert scenario_of(scene, name) == scenario
    assert scenario.par["time_s"] < scenario.goal.time_limit_s
    assert len(scenario.hint) > 10
    assert scenario.goal.forbidden
    for limit in (*LIMITS.values(), *scenario.limits.values()):
        assert limit.source == ASSUMPTION or len(limit.source) > 10


def test_what_sets_scenarios_apart_is_in_them() -> None:
    assert load_scenario("mirrored").view.mirrored
    one_handed = load_scenario("one-handed")
    assert one_handed.view.one_handed
    assert len(load_scene(one_handed.scene, one_handed.set).forceps) == 1
    weak, usual = (load_scene(each.scene, each.set).duct for each in map(load_scenario, ("weak-wall", "basic")))
    assert weak.youngs_modulus_pa < 0.5 * usual.youngs_modulus_pa
    assert load_scenario("weak-wall").limit("tool_duct_force_n") < LIMITS["tool_duct_force_n"].value
    assert load_scene(load_scenario("narrow").scene).duct.taper > 0.0
    assert "gallstones" in load_scene(load_scenario("stone").scene).effects


def test_a_scene_without_a_name_for_it_has_the_plain_scenario_made_of_it_or_none() -> None:
    assert [each and each.name for each in (scenario_of(scene, None) for scene in ("default", "stone", "pinch"))] == [
        "basic", "stone", None,
    ]  # fmt: skip
    with pytest.raises(ConfigError, match="scenario stone is made of scene 'stone': `trocar up --scenario stone`"):
        scenario_of("default", "stone")
    with pytest.raises(ConfigError, match="--scene pinch: scenario stone is made of scene stone"):
        made_of("stone", "pinch", ())


def test_a_half_written_file_stands_in_the_way_of_who_names_it_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(config.config_directory(), tmp_path / "configs")
    monkeypatch.setenv("TROCAR_CONFIG_DIR", str(tmp_path / "configs"))
    (tmp_path / "configs" / "scenarios" / "almost.yaml").write_text("title: [")
    basic = scenario_of("default", None)
    assert basic is not None
    assert basic.name == "basic"
    with pytest.raises(ConfigError, match=r"almost.yaml: line 1"):
        scenario_of("default", "almost")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{scene: default, goal: {depth_m: 0.01}}", "title: this key is missing"),
        ("{title: a, scene: default, goal: {depth_m: 0.01}, hints: b}", "unknown key 'hints'; .* did you mean 'hint'"),
        ("{title: a, scene: nowhere, goal: {depth_m: 0.01}}", "scene: there is no scene 'nowhere'"),
        ("{title: a, scene: default, goal: {depth_m: -1.0}}", "goal.depth_m: must be positive, is -1"),
        ("{title: a, scene: default, goal: {depth_m: 0.03}}", "goal.depth_m: lies beyond limits.depth_max_m, 0.02"),
        ("{title: a, scene: default, goal: {depth_m: 0.01, hold_s: 400.0}}", "goal.hold_s: must be at least 0 and bel"),
        ("{title: a, scene: default, goal: {depth_m: 0.01, phases: [P3, P2]}}", "goal.phases: each may come once"),
        (
            "{title: a, scene: default, goal: {depth_m: 0.01, forbidden: [E99]}}",
            "goal.forbidden.0: input should be 'E1'",
        ),
        (
            "{title: a, scene: default, goal: {depth_m: 0.01}, limits: {force: {value: 1.0}}}",
            "limits.force: unknown limit; known: tool_duct_force_n",
        ),
        (
            "{title: a, scene: default, goal: {depth_m: 0.01}, limits: {grasp_force_n: {value: 0.0}}}",
            "limits.grasp_force_n.value: must be positive, is 0",
        ),
        (
            "{title: a, scene: default, goal: {depth_m: 0.01}, limits: {grasp_force_n: {value: 1.0, source: ' '}}}",
            "limits.grasp_force_n.source: must name a source, or say 'assumption'",
        ),
        ("[1]", "must be a mapping"),
    ],
)
def test_a_mistake_in_a_scenario_is_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "mine.yaml"
    assert_refused(load_scenario, file, text, f"^{re.escape(str(file))}.*{said}")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.long] * (name != "one-handed"))
        for name in NAMES
        if name != "mirrored"  # to the mechanics it is `basic`
    ],
)
@pytest.mark.usefixtures("patient")
def test_simulated_hands_reach_the_goal_as_par_says(name: str) -> None:
    """At the pace of the stub rig, through haptics and physics, judged as a recording is."""
    found = attempt_of_hands(load_scenario(name))
    assert found.outcome == "success", found.reason
    assert [error for error in found.errors if error.severity == "critical"] == []
    par = load_scenario(name).par
    assert set(par) == set(PAR)
    assert {key: found.metrics[key] for key in par} == pytest.approx(par, rel=0.1, abs=1e-3)
