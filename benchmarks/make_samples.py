"""The sample recordings: ``python -m benchmarks.make_samples`` runs the rig for each and keeps what a replay needs.

Of device frames only what physics is told of, which a tenth of the room holds; of states and pictures some. They are to
be made anew when the mechanics change: `trocar replay` refuses those that others made.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import msgspec
from mcap.reader import make_reader

from benchmarks.report import parse
from trocar.protocol.bodies import GatewayState
from trocar.services.recorder.recording import RecordingWriter
from trocar.services.recordings.reader import read_extras, read_frames
from trocar.services.recordings.scene_update import LOG, SCENE, TRANSFORMS

FOLDER = Path(__file__).parents[1] / "docs" / "examples" / "recordings"
#: Name, scene, seconds.
SAMPLES = (("insertion-success", "insertion", 5.0), ("insertion-miss", "miss", 5.0))
_PACE = 0.6
_TOLD = ("name", "position_m", "orientation_wxyz", "port_m", "roll_rad", "handle_angle_rad")
#: One of so many is kept; other topics are left out.
_EVERY = {
    "gateway.state": 1, "haptics.journal": 1, "physics.journal": 1, "supervisor.state": 20, "physics.state": 3,
    "haptics.contacts": 10, SCENE: 2, TRANSFORMS: 2, LOG: 1,
}  # fmt: skip


def record(scene: str, seconds: float, folder: Path) -> Path:
    """Return the recording of a run of the rig."""
    devices = [f"gateway.instruments.{i}.{part}.settings.pace={_PACE}" for i in (0, 1) for part in ("arm", "grasp")]
    settings = [*devices, f"recorder.directory={folder}", f"transport.directory={folder}/bus"]
    command = ["trocar", "up", "--scene", scene, "--seconds", str(seconds), "--viewer", "none"]
    subprocess.run([*command, *(word for each in settings for word in ("--set", each))], check=True)
    (path,) = folder.glob("*.mcap")
    return path


def thin(path: Path, out: Path) -> None:
    """Write what a sample keeps of a recording."""
    metadata, attachments = read_extras(path)
    about = metadata["trocar"] | {"host": "sample"}
    writer = RecordingWriter(out, about, to_wall_ns=int(about["wall_minus_monotonic_ns"]))
    for name, data in attachments.items():
        writer.attach(name, "application/x-npz" if name.endswith(".npz") else "application/yaml", data)
    seen: Counter[str] = Counter()
    for each in read_frames(path, [topic for topic in _EVERY if not topic.startswith("/")]):
        frame = each.frame
        seen[frame.topic] += 1
        if (seen[frame.topic] - 1) % _EVERY[frame.topic] == 0:
            is_devices = isinstance(frame.body, GatewayState)
            writer.write(msgspec.structs.replace(frame, body=_told(frame.body)) if is_devices else frame)
    with path.open("rb") as file:
        for _schema, channel, message in make_reader(file).iter_messages([SCENE, TRANSFORMS, LOG]):
            seen[channel.topic] += 1
            if (seen[channel.topic] - 1) % _EVERY[channel.topic] == 0:
                writer.draw(channel.topic, message.log_time - writer.to_wall_ns, message.data)
    writer.close()


def _told(state: GatewayState) -> GatewayState:
    kept = tuple(type(each)(**{name: getattr(each, name) for name in _TOLD}) for each in state.instruments)
    return msgspec.structs.replace(state, instruments=kept)


def main() -> None:
    """Make all samples anew."""
    parse(__doc__)
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, scene, seconds in SAMPLES:
        with tempfile.TemporaryDirectory() as folder:
            path = record(scene, seconds, Path(folder))
            out = FOLDER / f"{name}.mcap"
            out.unlink(missing_ok=True)
            thin(path, out)
            print(f"{out}: {out.stat().st_size} bytes")


if __name__ == "__main__":
    sys.exit(main())
