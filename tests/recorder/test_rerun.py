"""The same hands through the same physics lead to the same states, to the bit, whatever was late."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from msgspec import structs
from typer.testing import CliRunner

from tests.recorder.conftest import TICKS
from tests.recorder.recorded_rig import changed
from trocar.protocol import Frame
from trocar.services.cli.app import app
from trocar.services.cli.rerun import compare
from trocar.services.recordings import inputs as recorded_inputs
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.inputs import read_inputs
from trocar.services.recordings.reader import RecordedFrame


def test_states_and_contacts_are_those_recorded_to_the_bit(recorded: Path) -> None:
    """Ticks were lost on both ways, states were too old to act on, and the quality was lowered and raised."""
    inputs = read_inputs(recorded)
    assert {intake.level for intake in inputs.intakes} == {0, 1}
    assert {intake.ticks for intake in inputs.intakes} >= {0, 1, 2, 3}
    assert {intake.tick - intake.seen_tick for intake in inputs.intakes if intake.seen_tick >= 0} >= {1, 2, 3}
    assert not all(intake.is_fresh for intake in inputs.intakes)
    assert max(tool.contacts for state in inputs.states.values() for tool in state.reactions()) > 0
    found = compare(inputs)
    assert found.compared > TICKS // 30
    assert (found.alike, found.first_difference) == (found.compared, "")
    assert found.ticks > 0.95 * TICKS


def test_a_hand_that_was_elsewhere_by_a_nanometre_is_seen_and_told_where(recorded: Path) -> None:
    inputs = read_inputs(recorded)
    at = next(k for k, each in enumerate(inputs.intakes) if each.tick >= TICKS // 3 and each.ticks and not each.level)
    inputs.intakes[at] = replace(inputs.intakes[at], devices=changed(inputs.intakes[at].devices, 1e-9))
    found = compare(inputs)
    assert found.alike < found.compared
    tick = int(found.first_difference.removeprefix("tick ").partition(":")[0])
    assert tick >= inputs.intakes[at].tick


@pytest.mark.parametrize("moved", [True, False])
def test_hands_that_moved_before_they_were_recorded_are_told(
    recorded: Path, monkeypatch: pytest.MonkeyPatch, moved: bool
) -> None:
    read, lost = recorded_inputs.read_frames, 5

    def without_the_first(path: Path, topics: tuple[str, ...]) -> Iterator[RecordedFrame]:
        for each in read(path, topics):
            if each.frame.topic != "gateway.state" or each.frame.body.tick > lost:
                yield replace(each, frame=each.frame if moved else _at_rest(each.frame))

    monkeypatch.setattr(recorded_inputs, "read_frames", without_the_first)
    inputs = read_inputs(recorded)
    early = [each for each in inputs.intakes if each.tick <= lost]
    assert early
    assert inputs.guessed == (len(early) if moved else 0)
    lost = 60  # by then a table of contacts was kept
    result = CliRunner().invoke(app, ["replay", str(recorded), "--check"])
    assert "the first difference: tick " in result.output
    assert ("ticks are missing, and moved: it may come of that" in result.output) == moved


def _at_rest(frame: Frame) -> Frame:
    """Return a device frame without tools, which therefore do not move; others as they are."""
    return (
        structs.replace(frame, body=structs.replace(frame.body, instruments=()))
        if frame.topic == "gateway.state"
        else frame
    )


def test_the_command_says_so(recorded: Path) -> None:
    result = CliRunner().invoke(app, ["replay", str(recorded), "--check"])
    assert result.exit_code == 0, result.output
    assert "kept states are alike" in result.output
    assert "another version" not in result.output


def test_another_version_of_the_mechanics_is_said_and_tried(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorded_inputs, "mechanics_digest", lambda: "0" * 64)
    result = CliRunner().invoke(app, ["replay", str(recorded), "--check"])
    assert result.exit_code == 0, result.output
    assert re.search(
        r"a\.mcap: was made by another version of the mechanics \([0-9a-f]{12}, these are 0{12}\)", result.output
    )
    found = json.loads(CliRunner().invoke(app, ["replay", str(recorded), "--check", "--json"]).output)
    assert (found["other_mechanics"], found["alike"]) == (True, found["compared"])


def test_without_its_scene_it_is_refused(recorded: Path) -> None:
    inputs = read_inputs(recorded)
    del inputs.attachments["scene.yaml"]
    with pytest.raises(RecordingError, match=r"a\.mcap: its scene is not in it"):
        inputs.check_scene()


def test_what_lacks_its_beginning_is_refused_with_the_reason(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = recorded_inputs.read_frames

    def without_first_journal(path: Path, topics: tuple[str, ...]) -> object:
        return (
            each for each in read(path, topics) if each.frame.topic != "physics.journal" or each.frame.body.noted > 0
        )

    monkeypatch.setattr(recorded_inputs, "read_frames", without_first_journal)
    with pytest.raises(RecordingError, match=r"physics\.journal begins \d+ ticks after it"):
        read_inputs(recorded)
