"""The sample recordings: ``python -m benchmarks.make_samples`` makes them, at a release and not for each change.

Haptics and physics are run tick by tick in this process, by a clock that is never late; the hands are those of the
scene, as a device reports them that is read 100 times a second with steps of a micrometre. So a sample is small, the
same sources make the same file again, and it has what a recording of a rig has: the scene, the devices of each tick,
journals, states, contacts, log and pictures. A later version reads it by upgrade, as any older recording.
"""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import io
import sys
import tempfile
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np
from mcap.reader import make_reader

from benchmarks.report import parse
from trocar.protocol import PROTOCOL_VERSION, TOPICS, Frame
from trocar.protocol.bodies import GatewayState, InstrumentState, SupervisorState
from trocar.services.cli.rerun import Rerun
from trocar.services.files.cache_directory import cache_directory
from trocar.services.gateway.motions.scene_hands import SceneHand, find_scene_hands
from trocar.services.gateway.motions.script import HANDLE, HIP, ROLL, Player
from trocar.services.mechanics.arrays import FloatArray
from trocar.services.mechanics.reduction.build import ignore_progress
from trocar.services.mechanics.scene.tool_orientation import tool_orientation
from trocar.services.recorder import attachments
from trocar.services.recorder.disk import RecordingFile
from trocar.services.recorder.picture import PictureRecorder
from trocar.services.recorder.recording import RecordingWriter
from trocar.services.recordings.chunks import OpenChunk
from trocar.services.recordings.inputs import Intake
from trocar.services.recordings.provenance import machine, mechanics_digest
from trocar.services.recordings.scene_update import SceneDrawing
from trocar.services.runtime.bus.journal import JournalWriter
from trocar.services.runtime.config import config
from trocar.services.scenes import load_duct, load_scene

FOLDER = Path(__file__).parents[1] / "docs" / "examples" / "recordings"
#: Name and scene.
SAMPLES = (("insertion-success", "insertion"), ("insertion-miss", "miss"))
#: The scene's hands have then slid the catheter 20 mm into the duct.
TICKS = 1800
#: Coarse, as modes and states would be most of a file.
COARSE = ("duct.n_around=12", "duct.n_along=16", "duct.n_modes=12", "catheter.n_segments=22")
#: Of a device's position in m, roll and opening in rad: a power of two, which leaves the low bits of a number empty.
QUANTUM = 2.0**-20
READ_EVERY, STATE_EVERY, CONTACTS_EVERY, SUPERVISOR_EVERY = 10, 100, 400, 1000
TICK_NS = 1_000_000
#: Of its wall clock: 2026-01-01, so that a sample made again is the same file.
BEGAN_NS = 1_767_225_600_000_000_000
_LEVEL = 19
_ABOUT = "a sample: scripted hands, computed without processes of a rig"


class Hand:
    """A hand of the scene, and the device that reports it."""

    def __init__(self, name: str, hand: SceneHand) -> None:
        self._name, self._port_m = name, hand.port_m
        self._player = Player(hand.motion, loop=False, port_m=hand.port_m, pace=1.0)

    def at(self, tick: int) -> InstrumentState:
        """Return what the device reports at a tick."""
        self._player.sample(1e-3 * (tick - tick % READ_EVERY))
        value = _rounded(self._player.value)
        pose = np.zeros(4)
        tool_orientation(value[HIP : HIP + 3], np.array(self._port_m), value[ROLL], pose)
        x, y, z = value[HIP : HIP + 3].tolist()
        w, a, b, c = _rounded(pose).tolist()
        return InstrumentState(
            name=self._name,
            position_m=(x, y, z),
            orientation_wxyz=(w, a, b, c),
            port_m=self._port_m,
            roll_rad=float(value[ROLL]),
            handle_angle_rad=float(value[HANDLE]),
        )


def _rounded(values: FloatArray) -> FloatArray:
    return np.rint(values / QUANTUM) * QUANTUM


class Sample:
    """A recording being made, by a clock that is never late."""

    def __init__(self, scene_name: str, path: Path) -> None:
        rig = config.load_rig("stub")
        scene = load_scene(scene_name, COARSE)
        duct = load_duct(scene, cache_directory(), ignore_progress)
        about = {"rig": rig.name, "scene": scene_name, "host": "sample", "trocar": version("trocar")}
        about |= {"mechanics": mechanics_digest(), "machine": machine()}
        self._writer = RecordingWriter(path, about, to_wall_ns=BEGAN_NS)
        for attached in (*attachments.settings(rig, scene_name, COARSE), attachments.surface(duct)):
            self._writer.attach(*attached)
        self._picture = PictureRecorder(BEGAN_NS)
        self._picture.drawing = SceneDrawing(scene, duct)
        self._journals = [JournalWriter(f"{name}.journal", self) for name in ("haptics", "physics")]  # type: ignore[arg-type]
        hands = find_scene_hands(scene_name, COARSE).hands
        self._hands = [Hand(row.name, hand) for row, hand in zip(rig.gateway.instruments, hands, strict=True)]
        self._rerun, self._seen = Rerun(scene, duct), -1
        self._sequences: dict[str, int] = {}
        self._now_ns = 0

    def run(self, ticks: int) -> None:
        """Record so many ticks, and end the file."""
        for tick in range(ticks):
            self._step(tick, is_last=tick == ticks - 1)
        for journal in self._journals:
            journal.send()
        self._writer.close()

    def publish(self, topic: str, body: msgspec.Struct) -> None:
        """Append a body: journals take this object for their bus."""
        self._write(self._frame(topic, body))

    def _step(self, tick: int, is_last: bool) -> None:
        self._now_ns = tick * TICK_NS
        if tick % SUPERVISOR_EVERY == 0:
            self.publish("supervisor.state", SupervisorState(state="running", reason=_ABOUT))
        devices = self._frame(
            "gateway.state", GatewayState(tick=tick, instruments=tuple(h.at(tick) for h in self._hands))
        )
        self._write(devices)
        intake = Intake(tick, devices, seen_tick=self._seen, is_fresh=self._seen >= 0, ticks=1)
        contacts, state = self._rerun.step(intake)
        facts = (tick - self._seen if self._seen >= 0 else -1, int(intake.is_fresh), 0), (1, 0, 0)
        for journal, each in zip(self._journals, facts, strict=True):
            journal.note(tick, each)
            journal.send_if_due()
        if contacts is not None and tick % CONTACTS_EVERY == 0:
            self.publish("haptics.contacts", contacts)
        if state is not None:
            self._seen = tick
            if tick % STATE_EVERY == 0 or is_last:
                self.publish("physics.state", state)
        for drawn in self._picture.draw(self._now_ns):
            self._writer.draw(*drawn)

    def _frame(self, topic: str, body: msgspec.Struct) -> Frame:
        sequence = self._sequences[topic] = self._sequences.get(topic, -1) + 1
        sent_ns = self._now_ns + list(TOPICS).index(topic)
        return Frame(PROTOCOL_VERSION, topic, TOPICS[topic].version, 1, sequence, sent_ns, self._now_ns, True, body)

    def _write(self, frame: Frame) -> None:
        self._writer.write(frame)
        self._picture.see(frame)


def pack(path: Path, out: Path) -> None:
    """Write a recording anew, topic by topic and with more effort than a recorder of a rig has time for."""
    with path.open("rb") as source:
        reader, file = make_reader(source), RecordingFile(out, shared=True)
        for metadata in reader.iter_metadata():
            file.add_metadata(metadata.name, metadata.metadata)
        for each in reader.iter_attachments():
            data = _with_rounded_modes(each.data) if each.name == "duct.npz" else each.data
            file.add_attachment(replace(each, create_time=BEGAN_NS, log_time=BEGAN_NS, data=data))
        summary = reader.get_summary()
        assert summary is not None
        for channel in summary.channels.values():
            file.declare(summary.schemas[channel.schema_id])
            file.declare(channel)
            chunk = OpenChunk(level=_LEVEL)
            for _, _, message in reader.iter_messages([channel.topic]):
                chunk.add(channel.id, message.sequence, message.log_time, message.publish_time, message.data)
            file.add_chunk(chunk)
        file.close()


def _with_rounded_modes(npz: bytes) -> bytes:
    """Return the file of a duct with modes of 11 bits: half the bytes, and places that are right to micrometres."""
    with np.load(io.BytesIO(npz)) as stored:
        arrays = dict(stored)
    quantum = 2.0 ** np.floor(np.log2(np.abs(arrays["modes"]).max()) - 10)
    arrays["modes"] = (np.rint(arrays["modes"] / quantum) * quantum).astype(np.float32)
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def main() -> None:
    """Make all samples anew."""
    parse(__doc__)
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, scene in SAMPLES:
        with tempfile.TemporaryDirectory() as folder:
            path, out = Path(folder) / "whole.mcap", FOLDER / f"{name}.mcap"
            Sample(scene, path).run(TICKS)
            out.unlink(missing_ok=True)
            pack(path, out)
            print(f"{out}: {out.stat().st_size} bytes")


if __name__ == "__main__":
    sys.exit(main())
