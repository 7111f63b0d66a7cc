"""A long command in a pipe: lines that say how far it is and how long it will still take."""

from __future__ import annotations

import time

import pytest

from trocar.services.scenes import load_scene
from trocar.studies.accuracy.trial import Trial
from trocar.studies.accuracy.tuning import count_runs
from trocar.studies.commands import progress_bar
from trocar.studies.commands.fem import Stages
from trocar.studies.commands.progress_bar import Estimate, in_words, progress_line
from trocar.studies.commands.tune import CountedTrial, expected_s


def test_the_rest_takes_as_long_as_what_is_done_did() -> None:
    now = [0.0]
    estimate = Estimate(lambda: now[0])
    assert estimate.line() == "preparing, time left not known yet; 0 s so far"
    estimate.tell("errors", 0, 12)
    now[0] = 30.0
    assert estimate.line() == "errors: 0 of 12, time left not known yet; 30 s so far"
    estimate.tell("errors, mesh", 3, 12)
    assert estimate.line() == "errors, mesh: 3 of 12, about 90 s left of it; 30 s so far"
    now[0] = 40.0
    estimate.tell("costs", 0, 4)  # another part: what went before says nothing of it
    assert estimate.left_s() is None
    now[0] = 44.0
    estimate.tell("costs", 2, 4)
    assert estimate.left_s() == pytest.approx(4.0)


def test_what_was_done_before_is_no_pace() -> None:
    now = [0.0]
    estimate = Estimate(lambda: now[0])
    estimate.tell("cases", 90, 100)
    now[0] = 10.0
    estimate.tell("cases", 95, 100)
    assert estimate.left_s() == pytest.approx(10.0)


def test_lengths_of_time_in_words() -> None:
    assert [in_words(seconds) for seconds in (0.4, 119.0, 122.0, 3000.0, 5400.0)] == [
        "0 s", "119 s", "2 min", "50 min", "1.5 h",
    ]  # fmt: skip


def test_lines_come_in_a_pipe_also_while_one_step_takes_long(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress_bar, "EVERY_S", 0.05)
    with progress_line() as tell:
        tell("cases, pinch", 1, 8)
        said, end_s = "", time.monotonic() + 60.0
        while said.count("\n") < 3:
            assert time.monotonic() < end_s, said
            time.sleep(0.01)
            out, err = capsys.readouterr()
            said += err
            assert out == ""
    assert said.splitlines()[2].startswith("cases, pinch: 1 of 8, ")
    capsys.readouterr()
    time.sleep(0.2)
    assert capsys.readouterr().err == ""


def test_stages_of_a_case_are_told() -> None:
    told: list[tuple[str, int, int]] = []
    stages = Stages(lambda *said: told.append(said))
    for said in (("mesh", 1), ("path", 2), ("", 1), ("", 1), ("", 1)):
        stages(*said)
    assert told == [("mesh", 0, 1), ("path", 0, 2), ("path", 1, 2), ("path", 2, 2), ("path", 2, 2)]


def test_tuning_says_beforehand_how_long_it_takes() -> None:
    everything, insertion = load_scene("everything"), load_scene("insertion")
    assert count_runs(everything, is_walk=True) > count_runs(everything, is_walk=False) > 20.0
    assert expected_s(everything, None) > expected_s(insertion, None) > 0.5


def test_tuning_tells_how_much_of_all_runs_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Trial, "run", lambda *_: None)
    monkeypatch.setattr(Trial, "tick", lambda *_: None)
    told: list[tuple[str, int, int]] = []
    trial, scene = CountedTrial(lambda *said: told.append(said), 4.7), load_scene("insertion")
    trial.take_part("reference", 0, 1)
    trial.run(scene, 0.5e-3)
    trial.take_part("ladder", 0, 3)
    trial.tick(scene)
    trial.run(scene)
    trial.run(scene)
    assert told == [("reference", 0, 5), ("reference", 2, 5), *(("ladder", done, 5) for done in (2, 3, 4, 5))]
