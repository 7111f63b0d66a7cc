"""``trocar replay``: a recorded simulation run again, and compared with what was recorded."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass
from pathlib import Path

import typer

from trocar.services.cli import pictures
from trocar.services.cli.rerun import compare
from trocar.services.cli.up import Request, run_up
from trocar.services.messages.exit_codes import ExitCode
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.inputs import read_inputs
from trocar.services.recordings.reader import read_extras
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config import config
from trocar.services.supervisor.control.supervisor import Supervisor
from trocar.services.supervisor.crew.fork_link import ForkServer

#: Characters of a scene's name that a file has for it, each up to four bytes.
_NAME_MAX = 60


def run_check(path: Path, as_json: bool) -> None:
    """Run the inputs of a recording again and say whether the states are those recorded; exit code 1 if not.

    Raises RecordingError if it cannot be run again, with the reason.
    """
    inputs = read_inputs(path)
    inputs.check_scene()
    found = compare(inputs)
    if as_json:
        said = {"ended": inputs.ended, "guessed": inputs.guessed, "other_mechanics": bool(inputs.other_mechanics)}
        print(json.dumps({"file": str(path), **asdict(found), **said}))
    else:
        until = f", up to where {inputs.ended}" if inputs.ended else ""
        print(f"{path}: {found.ticks} ticks run again{until}; {found.alike} of {found.compared} kept states are alike")
        if found.first_difference:
            print(f"the first difference: {found.first_difference}")
            print(f"at the end the catheter is {1e6 * found.apart_m:.3g} um from where it was")
            if inputs.guessed:
                print(f"the hands of its first {inputs.guessed} ticks are missing, and moved: it may come of that")
        if inputs.other_mechanics:
            print(inputs.other_mechanics)
        if inputs.machine_differs or found.has_other_modes:
            print("it was recorded on another kind of machine or with other libraries: the last bits may differ")
    if found.first_difference or not found.compared:
        raise typer.Exit(ExitCode.FAILURE)


@dataclass(frozen=True, slots=True)
class ReplayRequest:
    """What a person asked for: see `trocar.services.runtime.config.rig.ReplaySettings`."""

    file: Path
    rig: str
    rate: float
    from_s: float
    until_s: float | None
    loop: bool
    take_over: bool
    pictures: bool
    viewer: str | None
    overrides: tuple[str, ...]


def run_replay(asked: ReplayRequest, fork_server: ForkServer) -> None:
    """Start a rig whose device frames are those of a recording, in the scene of the recording.

    Raises RecordingError if it cannot be run again, with the reason.
    """
    if asked.pictures:
        return _show(asked, fork_server)
    inputs = read_inputs(asked.file)
    inputs.check_scene()
    if inputs.other_mechanics:
        print(inputs.other_mechanics)
    if inputs.ended:
        print(f"{asked.file}: can be run up to where {inputs.ended}")
    settings = {
        "file": str(asked.file.resolve()), "rate": asked.rate, "from_s": asked.from_s, "until_s": asked.until_s,
        "loop": asked.loop, "take_over": asked.take_over,
    }  # fmt: skip
    # A replay waits for itself: what is late is slow, and no contract is broken.
    overrides = (f"replay={json.dumps(settings)}", "contracts={loops: {}, paths: {}}", *asked.overrides)
    ends_when = _never if asked.take_over else _is_over
    with tempfile.TemporaryDirectory() as folder:
        scene = _scene_file(Path(folder), inputs.metadata, inputs.attachments)
        request = Request(asked.rig, str(scene), None, None, asked.viewer, overrides, ends_when=ends_when)
        return run_up(request, fork_server)


def _show(asked: ReplayRequest, fork_server: ForkServer) -> None:
    """Show what was recorded: only the picture runs."""
    metadata, attachments = read_extras(asked.file)
    if "scene.yaml" not in attachments:
        raise RecordingError(f"{asked.file}: its scene is not in it")
    overrides = (*pictures.IDLE, "contracts={loops: {}, paths: {}}", *asked.overrides)
    rig = config.load_rig(asked.rig, overrides)
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        scene = _scene_file(Path(folder), metadata.get("trocar", {}), attachments)

        def open_player() -> pictures.PicturePlayer:
            bus = stack.enter_context(closing(ZmqBus(rig.transport, publishes=pictures.TOPICS)))
            player = pictures.PicturePlayer(asked.file, bus, asked.rate, asked.until_s, loop=asked.loop)
            player.seek(asked.from_s)
            return player

        print(pictures.HELP)
        shown = pictures.shown_by(open_player)
        request = Request(asked.rig, str(scene), None, None, asked.viewer, overrides, ends_when=shown)
        run_up(request, fork_server)


def _scene_file(folder: Path, metadata: Mapping[str, str], attachments: Mapping[str, bytes]) -> Path:
    """Return a file with the scene of a recording, of its name."""
    stem = Path(metadata.get("scene", "scene").replace("\0", "")).stem
    name = "".join(each if each.isprintable() else "_" for each in stem)[:_NAME_MAX] or "scene"
    path = folder / f"{name}.yaml"
    path.write_bytes(attachments["scene.yaml"])
    return path


def _never(_supervisor: Supervisor) -> bool:
    return False


def _is_over(supervisor: Supervisor) -> bool:
    gateway = supervisor.crew.members["gateway"].health
    return gateway is not None and gateway.gauges.get("replayed", 0.0) > 0.0
