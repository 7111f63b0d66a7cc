"""An episode as a recording of the rig, for `trocar score`, `trocar report`, `trocar replay` and Foxglove."""

from __future__ import annotations

import platform
import time
from importlib.metadata import version
from pathlib import Path

import msgspec
import yaml

from trocar.envs.frames import Framer
from trocar.envs.stage import Stage
from trocar.protocol import Frame
from trocar.services.recorder.attachments import NPZ, YAML
from trocar.services.recorder.picture import PictureRecorder
from trocar.services.recorder.recording import RecordingWriter
from trocar.services.recordings.provenance import machine, mechanics_digest
from trocar.services.recordings.scene_update import SceneDrawing
from trocar.services.runtime.bus.journal import JournalWriter
from trocar.services.runtime.config import config

_WAITING_BYTES = 1 << 20
"""Bytes pending above which an episode, which is faster than the clock, waits for the disk and loses nothing."""


class EpisodeRecording:
    """A file being written, with all data for repeating the episode."""

    def __init__(self, path: Path, stage: Stage, framer: Framer) -> None:
        about = {
            "rig": "trocar.envs", "scene": Path(stage.name).stem, "host": platform.node(),
            "trocar": version("trocar"), "mechanics": mechanics_digest(), "machine": machine(),
        }  # fmt: skip
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path = path
        self._framer, self._level = framer, stage.level
        self._writer = RecordingWriter(path, about)
        scene = yaml.safe_dump(config.read_scene(str(stage.name), stage.overrides), sort_keys=False, allow_unicode=True)
        self._writer.attach("scene.yaml", YAML, scene.encode())
        self._writer.attach("duct.npz", NPZ, stage.duct_file)
        self._picture = PictureRecorder(self._writer.to_wall_ns)
        self._picture.drawing = SceneDrawing(stage.scene, stage.duct)
        self._haptics, self._physics = (JournalWriter(f"{name}.journal", self) for name in ("haptics", "physics"))  # type: ignore[arg-type]
        self._tick = self._solved_tick = -1

    def append_frame(self, frame: Frame) -> None:
        """Append a frame."""
        self._writer.write(frame)
        self._picture.see(frame)

    def append_tick(self, devices: Frame, step_ticks: int) -> None:
        """Append the devices of a tick, and the number of ticks simulated at its end, 0 for none."""
        self._tick = tick = devices.body.tick
        self.append_frame(devices)
        is_known = self._solved_tick >= 0
        self._haptics.note(tick, (tick - self._solved_tick if is_known else -1, int(is_known), 0))
        if step_ticks:
            self._physics.note(tick, (step_ticks, self._level, 0))
            self._solved_tick = tick

    def write_due(self) -> None:
        """Draw and write what is due."""
        now_ns = max(self._tick, 0) * 1_000_000
        for drawn in self._picture.draw(now_ns):
            self._writer.draw(*drawn)
        self._haptics.send_if_due()
        self._physics.send_if_due()
        self._writer.end_old_chunk(now_ns)
        while self._writer.pending_bytes > _WAITING_BYTES:
            time.sleep(1e-3)

    def publish(self, topic: str, body: msgspec.Struct) -> None:
        """Append a journal, which is published on this object as its bus."""
        self._writer.write(self._framer.frame(max(self._tick, 0), body, topic))

    def close(self) -> None:
        """Write pending data, and close the file."""
        self._haptics.send()
        self._physics.send()
        self._writer.close()
