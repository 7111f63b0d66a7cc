"""A moment of a recorded attempt, from which hands go on: the recording is run again up to it, then they take over."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from trocar.protocol.topics import TICK_S
from trocar.services.cli.attempt import made_of
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.inputs import RecordedInputs, read_inputs
from trocar.services.runtime.config import config, yaml_text

if TYPE_CHECKING:
    from trocar.services.cli.up import UpRequest


def request_from(request: UpRequest, moment: str) -> UpRequest:
    """Return what runs the rig of a request from a moment: name of a recording, one of its ticks, and its scenario.

    Raises UserError if the recording is not there, cannot be run again, or was made of another scene than the scenario
    has now.
    """
    name, tick, scenario = moment.split(" ")
    file = config.load_rig(request.rig, request.overrides).recorder.directory / name
    inputs = read_inputs(file)
    inputs.check_scene()
    _refuse_other_scene(file, inputs, scenario, request.overrides)
    first, last = inputs.intakes[0].tick, inputs.intakes[-1].tick
    if not first < int(tick) <= last:
        raise RecordingError(f"{file}: can be run again from tick {first} to {last}, and {tick} was asked for")
    seconds = (int(tick) - first) * TICK_S
    settings = {"file": str(file.resolve()), "from_s": seconds, "until_s": seconds, "take_over": True}
    # A replay waits for itself: what is late is slow, and no contract is broken.
    overrides = (f"replay={json.dumps(settings)}", "contracts={loops: {}, paths: {}}", *request.overrides)
    return replace(request, scene=None, scenario=scenario, overrides=overrides)


def _refuse_other_scene(file: Path, inputs: RecordedInputs, scenario: str, overrides: tuple[str, ...]) -> None:
    scene, all_of = made_of(scenario, None, overrides)
    now = config.read_scene(scene, config.split_overrides(all_of)[1])
    if yaml_text.read(inputs.attachments["scene.yaml"].decode()) != json.loads(json.dumps(now)):
        raise RecordingError(f"{file}: scenario {scenario} has another scene now than the one that it was made in")
