"""Tuning: what is given up, in which order, and what is written. Costs are made up: what a machine takes is no test."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from trocar.services.cli.app import add_installed_verbs, app
from trocar.services.files.cache_directory import cache_directory
from trocar.services.mechanics.effects.mucus_drag import MucusDragSettings
from trocar.services.mechanics.effects.self_contact import SelfContactSettings
from trocar.services.mechanics.scenarios import insertion_scene
from trocar.services.mechanics.scene import QualityLevel
from trocar.services.runtime.config import config
from trocar.services.runtime.errors import ConfigError
from trocar.services.scenes import build_scene, load_duct, load_scene
from trocar.studies.accuracy.study import Cost
from trocar.studies.accuracy.trial import Errors, Run, Trial, errors_of
from trocar.studies.accuracy.tuning import (
    Rung,
    Step,
    Tuned,
    finest,
    measure_ladder,
    steps_down,
    tune,
    walk_down,
    worth_having,
)
from trocar.studies.commands.tune import Request, run_tune, tuned_text

ESSENTIAL = ("friction", "grasp_slip", "gravity")


def example_scene():
    scene = insertion_scene()
    effects = {**scene.effects, "mucus_drag": MucusDragSettings(), "self_contact": SelfContactSettings()}
    return replace(scene, effects=effects, essential=ESSENTIAL, hands="pinch")


class MadeUp:
    """A machine whose costs and errors are sums over what a scene has: cheap modes, dear mucus, worthless sweeps."""

    def run(self, scene, dt_s=1e-3, level=0):
        rung = scene.quality[level]
        off = 4.0 / scene.duct.n_modes + 0.1 / scene.duct.n_around + 0.3 / rung.iterations**2
        off += 0.0 if "mucus_drag" in scene.effects and "mucus_drag" not in rung.without else 0.05
        return Run(np.full((4, 2, 4), 1.0 + off), np.full((4, 3), 1.0 + 0.5 * off), np.full(4, 1.0 + 0.5 * off))

    def costs(self, scenes):
        return [Cost(self._cost_us(scene, scene.quality[level]), 0.0, 0.5) for scene, level in scenes]

    def _cost_us(self, scene, rung):
        acting = [name for name in scene.effects if name not in rung.without]
        optional = 100.0 * ("mucus_drag" in acting) + 10.0 * ("self_contact" in acting)
        return 50.0 + 0.5 * scene.duct.n_modes + 2.0 * scene.catheter.n_segments + optional + 2.0 * rung.iterations


def made_up(budget_us):
    return tune(example_scene(), budget_us, MadeUp(), lambda *_: None)


def test_errors_are_relative_and_nothing_felt_is_no_error():
    reference = Run(np.full((5, 2, 4), 2.0), np.full((5, 3), 1.0), np.full(5, 4.0))
    off = Run(1.1 * reference.force_n, 1.02 * reference.tip_m, 1.05 * reference.wall)
    assert errors_of(off, reference) == Errors(pytest.approx(10.0), pytest.approx(5.0))
    nothing = Run(np.zeros((5, 2, 4)), np.zeros((5, 3)), np.zeros(5))
    assert errors_of(reference, nothing) == Errors(0.0, 0.0)


def test_what_is_essential_is_never_given_up():
    assert {step.effect for step in steps_down(example_scene()) if step.effect} == {"mucus_drag", "self_contact"}


def test_steps_down_change_what_they_say_and_nothing_else():
    scene = finest(example_scene())
    for step in steps_down(scene):
        after = step.apply(scene)
        assert after != scene
        assert step.is_less_than(scene)
        assert bool(step.effect) == (set(scene.effects) != set(after.effects))
        assert set(scene.effects) - set(after.effects) <= {step.effect}


def test_a_catheter_by_substeps_may_go_by_implicit_steps_and_that_is_written():
    scene = example_scene()
    assert not any("catheter.integrator" in step.changes for step in steps_down(scene))
    scene = replace(scene, catheter=replace(scene.catheter, integrator="semi_implicit"))
    (step,) = [step for step in steps_down(scene) if "catheter.integrator" in step.changes]
    after = step.apply(scene)
    assert after.catheter == replace(scene.catheter, integrator="implicit")
    assert step.is_less_than(scene)
    text = tuned_text(Request("paper", (), 200.0, Path("a.yaml"), json=False), tuned_to(after))
    assert "integrator: implicit" in text


def test_a_surface_file_is_meshed_coarser_by_longer_edges():
    scene = example_scene()
    scene = finest(replace(scene, duct=replace(scene.duct, mesh_file="a.stl", mesh_edge_m=1e-3)))
    steps = [step for step in steps_down(scene) if "duct.mesh_edge_m" in step.changes]
    assert len(steps) == 3
    assert all(step.is_less_than(scene) and not step.is_less_than(step.apply(scene)) for step in steps)


def test_the_way_down_never_climbs_again():
    scene = finest(example_scene())
    fine, coarse = Step("20", {"duct.n_modes": 20}), Step("10", {"duct.n_modes": 10})
    assert [[s.name for s in taken] for taken, _ in walk_down(scene, [coarse, fine])] == [[], ["10"]]


def test_what_frees_most_time_for_least_error_goes_first():
    tuned = made_up(1.0)
    names = [step.name for step in tuned.rungs[-1].steps]
    sweeps, mucus = names.index("30 sweeps"), names.index("no mucus_drag")
    assert "no self_contact" in names[:mucus]  # frees little, but for nothing
    assert sweeps < mucus


def test_a_budget_that_nothing_fits_ends_at_the_last_rung_and_says_so():
    tuned = made_up(1.0)
    assert not tuned.fits
    assert tuned.rungs[0].steps == ()
    assert all(len(after.steps) == len(before.steps) + 1 for before, after in pairwise(tuned.rungs))
    assert set(ESSENTIAL) <= set(tuned.scene.effects)


@pytest.mark.parametrize("budget_us", [1.0, 250.0])
def test_where_all_is_lost_in_noise_what_seems_cheaper_is_given_up_all_the_same(budget_us):
    """Nothing was given up, for any budget, and the scene left finer and dearer than it had been."""

    class Busy(MadeUp):
        def costs(self, scenes):
            return [replace(cost, noise_us=1e4) for cost in super().costs(scenes)]

    quiet, busy = (tune(example_scene(), budget_us, each, lambda *_: None) for each in (MadeUp(), Busy()))
    assert busy.fits == quiet.fits
    assert [rung.cost.median_us for rung in busy.rungs] == [rung.cost.median_us for rung in quiet.rungs]


def test_what_frees_less_than_the_noise_is_kept_where_the_rest_is_enough():
    class Tiny(MadeUp):
        def costs(self, scenes):
            return [replace(cost, noise_us=30.0) for cost in super().costs(scenes)]

    taken = {step.name for step in tune(example_scene(), 300.0, Tiny(), lambda *_: None).rungs[-1].steps}
    assert "no mucus_drag" in taken
    assert "no self_contact" not in taken  # frees 10 us
    assert "no self_contact" in {
        step.name for step in tune(example_scene(), 1.0, Tiny(), lambda *_: None).rungs[-1].steps
    }


def test_no_more_is_given_up_than_the_budget_asks_for():
    tuned = made_up(300.0)
    assert tuned.fits
    assert tuned.rungs[-1].cost.median_us <= 300.0 < tuned.rungs[-2].cost.median_us


def test_the_ladder_tells_what_each_rung_costs_and_loses():
    ladder = made_up(400.0).ladder
    assert ladder[0].name == "full"
    assert len(ladder) > 1
    assert all(after.cost_us < before.cost_us for before, after in pairwise(ladder))
    assert all(after.force_error_percent >= before.force_error_percent for before, after in pairwise(ladder))
    assert not any(name in ESSENTIAL for level in ladder for name in level.without)


def test_without_a_budget_the_scene_stays_as_it_is_and_only_its_ladder_is_measured():
    scene = example_scene()
    tuned = measure_ladder(scene, MadeUp(), lambda *_: None)
    assert replace(tuned.scene, quality=scene.quality) == scene
    assert tuned.ladder[0].name == "full"
    assert tuned.ladder[0].force_error_percent > 0.0
    assert len(tuned.ladder) > 1


def test_rungs_that_another_beats_or_that_free_less_than_the_noise_are_left_out():
    def level(name, cost_us, error):
        return QualityLevel(name=name, cost_us=cost_us, force_error_percent=error, motion_error_percent=0.0)

    full, beaten, good = level("full", 100.0, 1.0), level("beaten", 60.0, 9.0), level("good", 50.0, 2.0)
    noise, last = level("noise", 48.0, 2.5), level("last", 30.0, 4.0)
    assert worth_having([full, beaten, good, noise, last], 3.0) == (full, good, last)


def test_a_trial_feels_what_the_hands_do_and_times_every_rung():
    scene = example_scene()
    duct = replace(scene.duct, n_around=12, n_along=16, n_modes=20, membrane="cst")
    ladder = (QualityLevel(), QualityLevel(name="one sweep", iterations=1))
    scene = replace(scene, duct=duct, quality=ladder)
    trial = Trial(lambda each: load_duct(each, cache_directory(), lambda *_: None))
    full, again, least = trial.run(scene), trial.run(scene), trial.run(scene, level=1)
    assert errors_of(again, full) == Errors(0.0, 0.0)
    assert np.abs(full.force_n[-1, 1]).max() > 0.2
    assert full.wall[-1] > 10.0 * full.wall[100]
    assert 0.0 < errors_of(least, full).force_percent < 100.0
    costs = trial.costs([(scene, 0), (scene, 1)])
    assert all(cost.median_us > 0.0 for cost in costs)


def chosen_of(name):
    scene = load_scene(name)
    chosen = replace(scene, duct=replace(scene.duct, n_modes=24), effects={"friction": scene.effects["friction"]})
    return chosen, tuned_to(chosen)


def tuned_to(chosen):
    level = replace(chosen.quality[0], cost_us=100.0, force_error_percent=1.5, motion_error_percent=0.5)
    return Tuned([Rung((Step("24 modes"),), chosen, Cost(100.0, 120.0, 1.0), Errors(1.5, 0.5))], (level,), True)


@pytest.mark.parametrize("name", ["insertion", "anatomy"])
def test_what_is_written_is_the_tuned_scene(name, tmp_path):
    chosen, tuned = chosen_of(name)
    text = tuned_text(Request(name, (), 200.0, Path("tuned.yaml"), json=False), tuned)
    assert "# Given up for it: 24 modes." in text
    (tmp_path / "tuned.yaml").write_text(text)
    read = load_scene(tmp_path / "tuned.yaml")
    mesh_file = read.duct.mesh_file
    assert mesh_file is None or mesh_file == str(Path(chosen.duct.mesh_file).absolute())
    assert replace(read, duct=replace(read.duct, mesh_file=chosen.duct.mesh_file)) == tuned.scene


def test_overrides_are_written_too():
    _, tuned = chosen_of("insertion")
    text = tuned_text(Request("insertion", ("hands=pinch",), 200.0, Path("tuned.yaml"), json=False), tuned)
    assert "hands: pinch" in text


@pytest.mark.parametrize(
    ("scene", "budget_us", "out", "said"),
    [
        ("insertion", 0.0, "a.yaml", "--budget-us must be a positive number of microseconds, is 0"),
        ("insertion", math.nan, "a.yaml", "--budget-us must be a positive number of microseconds, is nan"),
        ("insertion", 100.0, "/dev/null/a.yaml", "--out /dev/null: is a file, not a folder"),
        ("insertion", 100.0, "a.txt", "--out a.txt: a scene file ends in .yaml"),
        ("inserton", 100.0, "a.yaml", "there is no scene 'inserton'"),
        ("duct-only", 100.0, "a.yaml", "scene duct-only: names but a duct; tuning needs tools"),
    ],
)
def test_bad_input_is_one_sentence(scene, budget_us, out, said):
    with pytest.raises(ConfigError, match=said) as caught:
        run_tune(Request(scene, (), budget_us, Path(out), json=False))
    assert "\n" not in str(caught.value)


def test_a_scene_without_tools_is_refused():
    with pytest.raises(ConfigError, match="scene pinch: forceps: has none, and without a tool nothing is felt"):
        run_tune(Request("pinch", ("forceps=[]",), None, Path("a.yaml"), json=False))


def test_longer_steps_are_on_the_ladder_where_they_free_time():
    class Halving(MadeUp):
        def costs(self, scenes):
            return [
                cost.shared(scene.quality[level].ticks_per_step)
                for cost, (scene, level) in zip(super().costs(scenes), scenes, strict=True)
            ]

    ladder = measure_ladder(example_scene(), Halving(), lambda *_: None).ladder
    assert ladder[-1].ticks_per_step == 2
    assert ladder[-1].name.startswith("steps of 2 ms")
    assert ladder[-1].cost_us < 0.55 * ladder[0].cost_us


def test_the_command_prints_what_was_given_up_and_writes_the_scene(tmp_path, monkeypatch):
    made_up = MadeUp()
    made_up.take_part = lambda *_: None
    monkeypatch.setattr("trocar.studies.commands.tune.CountedTrial", lambda tell, n_runs: made_up)
    out = tmp_path / "tuned.yaml"
    add_installed_verbs()
    result = CliRunner().invoke(app, ["tune", "--scene", "pinch", "--budget-us", "1", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "Nothing that may be given up brings a tick to 1 us." in result.output
    assert "Ladder while it runs:" in result.output
    assert build_scene(config.read_yaml(out), "tuned").quality[0].cost_us is not None


def test_rounding_of_what_lies_still_is_no_error_and_motion_of_it_is():
    """In a pinch the catheter hangs still: by 1e-13 mm, of which rounding is 140 %."""
    force = np.ones((5, 2, 4))
    still = Run(force, 1e-16 * np.arange(15.0).reshape(5, 3), np.ones(5))
    again = Run(force, np.zeros((5, 3)), np.ones(5))
    assert errors_of(again, still) == Errors(0.0, 0.0)
    pushed = Run(force, np.full((5, 3), 1e-3), np.ones(5))
    assert errors_of(pushed, still).motion_percent > 100.0
    assert errors_of(still, pushed).motion_percent == pytest.approx(100.0)
    untouched, rung = Run(force, pushed.tip_m, np.full(5, 1e-13)), Run(force, pushed.tip_m, np.zeros(5))
    assert errors_of(rung, untouched) == Errors(0.0, 0.0)
