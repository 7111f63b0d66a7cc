"""To go on from a moment of a recorded attempt: its recording is run again up to the tick, in the scene as it was."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from trocar.services.cli import moment
from trocar.services.cli.attempt import made_of
from trocar.services.cli.moment import request_from
from trocar.services.cli.up import UpRequest
from trocar.services.recordings.errors import RecordingError
from trocar.services.runtime.config import config

FIRST, LAST = 120, 9120
REQUEST = UpRequest("mouse", None, None, None, None, ("recorder.directory=/recordings",), scenario="narrow")


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Return the scene of a recording of scenario `narrow`, which may be changed before it is read."""
    scene, overrides = made_of("narrow", None, REQUEST.overrides)
    held: dict[str, Any] = config.read_scene(scene, config.split_overrides(overrides)[1])

    def read(path: Any) -> SimpleNamespace:
        assert str(path) == "/recordings/one.mcap"
        return SimpleNamespace(
            attachments={"scene.yaml": yaml.safe_dump(held).encode()}, check_scene=lambda: None,
            intakes=[SimpleNamespace(tick=FIRST), SimpleNamespace(tick=LAST)],
        )  # fmt: skip

    monkeypatch.setattr(moment, "read_inputs", read)
    return held


@pytest.mark.usefixtures("recorded")
def test_the_recording_is_run_again_up_to_the_tick_and_hands_take_over() -> None:
    found = request_from(REQUEST, "one.mcap 3120 narrow")
    assert (found.scene, found.scenario, found.ends_when) == (None, "narrow", None)
    replay = json.loads(found.overrides[0].removeprefix("replay="))
    assert replay == {"file": "/recordings/one.mcap", "from_s": 3.0, "until_s": 3.0, "take_over": True}
    rig = config.load_rig(found.rig, found.overrides)
    assert rig.replay is not None
    assert rig.replay.take_over
    assert found.overrides[-1] == "recorder.directory=/recordings"


@pytest.mark.usefixtures("recorded")
@pytest.mark.parametrize("tick", [FIRST, LAST + 1])
def test_a_tick_that_is_not_in_it_is_refused(tick: int) -> None:
    with pytest.raises(RecordingError, match=f"can be run again from tick {FIRST} to {LAST}, and {tick} was asked for"):
        request_from(REQUEST, f"one.mcap {tick} narrow")


def test_a_scene_that_is_another_one_now_is_refused(recorded: dict[str, Any]) -> None:
    recorded["duct"] = {**recorded["duct"], "thickness_m": 2e-3}
    with pytest.raises(RecordingError, match="scenario narrow has another scene now"):
        request_from(REQUEST, "one.mcap 3120 narrow")
