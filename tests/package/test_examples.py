"""The examples of the front door: each runs from its first line to its last, and shows what it says."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.by_day import by_day
from tests.package.conftest import ROOT
from trocar.examples.ppo_baseline import ENVIRONMENT, RANGES

EXAMPLES = sorted(path.stem for path in (ROOT / "trocar" / "examples").glob("[a-z]*.py"))


def _run(name: str, folder: Path, *arguments: str) -> str:
    command = [sys.executable, "-m", f"trocar.examples.{name}", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def _numbers(line: str) -> list[float]:
    return [float(each) for each in re.findall(r"-?\d+\.?\d*", line)]


def test_these_are_the_examples() -> None:
    assert EXAMPLES == [
        "accuracy_against_time",
        "clone_an_expert",
        "insert_and_watch",
        "own_effect",
        "poke",
        "ppo_baseline",
    ]


def test_a_poke_is_felt_and_plotted(tmp_path: Path) -> None:
    assert 5e-3 < _numbers(_run("poke", tmp_path))[0] < 20e-3
    assert "<svg" in (tmp_path / "poke.svg").read_text()


def test_the_catheter_goes_in(tmp_path: Path) -> None:
    depth_mm = [_numbers(line)[1] for line in _run("insert_and_watch", tmp_path).splitlines() if " mm in " in line]
    assert depth_mm[0] == 0.0
    assert depth_mm[-1] == pytest.approx(20.0, abs=3.0)


def test_an_effect_of_ones_own_acts(tmp_path: Path) -> None:
    without, along = (_numbers(line) for line in _run("own_effect", tmp_path).splitlines())
    assert abs(without[1]) < 0.1
    assert 1.0 < along[1] < 20.0


def test_a_finer_wall_has_a_smaller_error(tmp_path: Path) -> None:
    lines = _run("accuracy_against_time", tmp_path).splitlines()[1:]
    errors = [_numbers(line)[3] for line in lines]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 2.0 > errors[2] >= errors[3] == 0.0


@pytest.mark.parametrize("episodes", by_day([1], [4]))
def test_a_clone_reaches_the_goal_in_an_episode_that_it_has_not_seen(tmp_path: Path, episodes: int) -> None:
    *shown, reached = _run("clone_an_expert", tmp_path, f"{episodes}").splitlines()
    assert [line.partition(",")[2].split(",")[0] for line in shown] == [f" seed {k}: success" for k in range(episodes)]
    assert reached.startswith("clone, seed 100: success")
    assert _numbers(reached)[2] > 10.0


def test_what_learns_by_trial_says_what_it_needs(tmp_path: Path) -> None:
    """Its packages are none that Trocar depends on."""
    text = """
import runpy, sys
sys.modules["stable_baselines3"] = None
runpy.run_module("trocar.examples.ppo_baseline", run_name="__main__")
"""
    done = subprocess.run([sys.executable, "-c", text], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "this example needs 'stable_baselines3': pip install stable-baselines3\n"


def test_what_learns_by_trial_finds_its_environment_in_a_process_of_its_own(tmp_path: Path) -> None:
    """Which has imported nothing of Trocar: those of stable-baselines3 begin so."""
    text = f"""
import gymnasium
made = gymnasium.make({ENVIRONMENT!r}, randomise={RANGES!r})
print(made.spec.id)
"""
    done = subprocess.run([sys.executable, "-c", text], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout == "trocar/Insertion-v0\n", done.stderr
