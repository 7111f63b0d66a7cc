"""The recorder: writes every frame of the topics in the rig file, and samples of all others, to a file.

It is an ordinary process and is delayed now and then; meanwhile frames wait in its queues, for up to half a minute.
"""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import logging
import platform
import sys
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from shutil import disk_usage

from trocar.protocol import Frame
from trocar.protocol.topics import observed_by, read_by
from trocar.services.files.cache_directory import cache_directory
from trocar.services.foreign_files import Refusal
from trocar.services.recorder import attachments
from trocar.services.recorder.losses import Losses, counts
from trocar.services.recorder.picture import PictureRecorder
from trocar.services.recorder.recording import RecordingWriter
from trocar.services.recordings.provenance import machine, mechanics_digest
from trocar.services.recordings.repair import repair_all
from trocar.services.recordings.scene_update import SceneDrawing
from trocar.services.runtime.bus.bus import Bus
from trocar.services.runtime.errors import UserError
from trocar.services.runtime.log import progress
from trocar.services.runtime.loop.loop import LoopMeter, ticks
from trocar.services.runtime.loop.tick_grid import STATES, as_state
from trocar.services.runtime.process.process import Process, ProcessConfig, main
from trocar.services.runtime.realtime import realtime
from trocar.services.scenes import load_duct, load_scene

#: Longer than the period of sampled topics, far shorter than a turn.
_PATIENCE_NS = 4_000_000
_TELL_NS = 1_000_000_000  # counts of a file that lasts for minutes: more often would only cost
#: Period of checking the disk, duration of a write that is reported as blocked, and pause between such reports.
_LOOK_S, _HELD_S, _HELD_AGAIN_S = 0.01, 0.02, 10.0
#: Most messages of one topic taken in a turn, about a second's of a fast one; the others wait for the next turn.
_AT_ONCE = 64
#: How long received frames are still written when the recorder is to end: less than half of the time until the
#: supervisor kills it, as the file has to be closed, too.
_LAST_S = 2.0


def _new_file(process: Process) -> Path:
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    return process.rig.recorder.directory / f"{process.rig.name}-{stamp}-{time.monotonic_ns() % 10**6:06d}.mcap"


def _metadata(process: Process) -> dict[str, str]:
    return {
        "rig": process.rig.name,
        "scene": process.scene_name,
        "host": platform.node(),
        "trocar": version("trocar"),
        "mechanics": mechanics_digest(),
        "machine": machine(),
    }


def whole(process_config: ProcessConfig) -> tuple[str, ...]:
    """Return the published topics of which the rig file requests every frame."""
    return tuple(filter(process_config.requirements.is_published, process_config.rig.recorder.whole))


class Recording:
    """A file being written, and its reports."""

    def __init__(self, process: Process) -> None:
        self._process = process
        now_ns = time.monotonic_ns()
        self._losses = Losses(now_ns)
        self._held_told_s = float("-inf")
        self._has_lost = False
        self._due_ns = now_ns + _TELL_NS
        self._writer = RecordingWriter(_new_file(process), _metadata(process), shared=process.rig.recorder.shared)
        self._picture = PictureRecorder(self._writer.to_wall_ns)
        process.log.info("writing %s", self._writer.path)

    def explain(self) -> None:
        """Attach settings and surface, and draw the scene from now on, if it can be loaded."""
        name, overrides = self._process.scene_name, self._process.scene_overrides
        try:
            for attached in attachments.settings(self._process.rig, name, overrides):
                self._writer.attach(*attached)
            scene = load_scene(name, overrides)
            duct = load_duct(scene, cache_directory(), progress)
        except UserError as error:
            self._process.log.warning("the recording does not show the scene: %s", error)
            return
        self._writer.attach(*attachments.surface(duct, scene))
        self._picture.drawing = SceneDrawing(scene, duct)
        self._picture.drawing.warm_up()

    def append_frames(self, frames: Iterable[Frame]) -> None:
        """Append `frames`."""
        for frame in map(as_state, frames):
            self._writer.write(frame)
            self._picture.see(frame)

    def sleep_until(self, due_ns: int) -> None:
        """Sleep, checking the disk while data is pending."""
        while (left_ns := due_ns - time.monotonic_ns()) > 0:
            self.look_at_disk()
            time.sleep(min(left_ns * 1e-9, _LOOK_S) if self._writer.pending_bytes else left_ns * 1e-9)

    def write_due(self, now_ns: int) -> None:
        """Draw and write what is due, and report the state."""
        for drawn in self._picture.draw(now_ns):
            self._writer.draw(*drawn)
        self._writer.end_old_chunk(now_ns)
        if now_ns < self._due_ns:
            return
        self._due_ns = now_ns + _TELL_NS
        self._report_losses(now_ns)
        lost, health = self._losses.sentence(), self._process.health
        health.gauges["recorded_frames"] = self._writer.frames
        health.gauges["lost_frames"] = self._losses.total.total()
        health.gauges["waiting_for_disk_bytes"] = self._writer.pending_bytes
        with suppress(OSError):
            health.gauges["disk_free_bytes"] = disk_usage(self._writer.path.parent).free
        health.change("degraded" if lost else "running", lost)

    def look_at_disk(self) -> None:
        """Report a blocked write or a full disk at once."""
        now_s = time.monotonic()
        held_s = self._writer.held_s()
        if held_s > _HELD_S and now_s - self._held_told_s >= _HELD_AGAIN_S:
            self._held_told_s = now_s
            said = f"the disk has held a write for {held_s * 1e3:.0f} ms, {self._writer.pending_bytes >> 10} kB wait"
            self._process.log.warning("%s", said)
            self._process.health.change("degraded", said)
        if self._writer.lost.total() and not self._has_lost:
            self._has_lost = True
            self._due_ns = 0

    def _report_losses(self, now_ns: int) -> None:
        new = self._losses.find_new(counts(self._process.bus.reports(), self._writer.lost), now_ns)
        for loss in new:
            self._writer.note(loss)
        for loss in self._losses.due_reports(new, now_ns):
            self._process.log.warning("lost %d frames of %s: %s", loss.frames, loss.topic, loss.why)

    def close(self) -> None:
        """Close the file, and report its contents and losses."""
        self._report_losses(time.monotonic_ns())
        self._writer.close()
        lost = self._losses.sentence()
        loudly = logging.WARNING if lost else logging.INFO
        said = self._writer.frames, self._writer.path, lost or "none lost"
        self._process.log.log(loudly, "%d frames in %s, %s", *said)


def _mend(process: Process) -> None:
    """Repair what other recorders left without an end, whatever that is, beside the recording."""
    for path, found in repair_all(process.rig.recorder.directory):
        if isinstance(found, Refusal):
            process.log.warning("a recording without an end is left as it is: %s", found)
        else:
            process.log.info("%s was not closed: indexed anew, %d frames", path, found.frames)


def run(process: Process) -> None:
    """Write received frames, then one frame of each sampled topic, in turns."""
    realtime.keep_heap()  # otherwise each chunk is new memory from the system
    bus, settings = process.bus, process.rig.recorder
    threading.Thread(target=_mend, args=(process,), name="mend", daemon=True).start()
    speaks = process.requirements.is_published
    read = dict.fromkeys(filter(speaks, (*settings.whole, *read_by("recorder"))))
    sampled = [topic for topic in filter(speaks, observed_by("recorder")) if topic not in read]
    if process.rig.simulated_time:  # moments are recorded instead
        sampled = [topic for topic in sampled if topic not in STATES]
    recording = Recording(process)
    recording.explain()
    meter = LoopMeter(settings.sample_rate_hz, ("take", "sample", "hand over"))
    process.ready(meter)
    try:
        for _tick in ticks(meter, process.stop, recording.sleep_until):
            began_ns = time.monotonic_ns()
            append_received(bus, read, recording, process.health.send_if_due)
            taken_ns = time.monotonic_ns()
            recording.append_frames(bus.sample(sampled, taken_ns + _PATIENCE_NS).values())
            sampled_ns = time.monotonic_ns()
            recording.write_due(sampled_ns)
            meter.stages_ns = (taken_ns - began_ns, sampled_ns - taken_ns, time.monotonic_ns() - sampled_ns)
            process.health.send_if_due()
        end_s = time.monotonic() + _LAST_S
        while append_received(bus, read, recording, process.health.send_if_due) and time.monotonic() < end_s:
            pass
    finally:
        recording.close()


def append_received(bus: Bus, topics: Iterable[str], recording: Recording, beat: Callable[[], object]) -> bool:
    """Append received frames, of each topic at most `_AT_ONCE`; return whether there may be more.

    After a long delay there are many frames. `beat` sends heartbeats while catching up, as otherwise the supervisor
    would take the recorder for hung and end it, and queued frames would be lost. The limit leaves time for other topics
    and for the file when a publisher floods.
    """
    more = False
    for topic in topics:
        for _ in range(_AT_ONCE):
            batch = bus.batch(topic)
            if batch is None:
                break
            recording.append_frames(batch.frames())
            beat()
        else:
            more = True
    return more


if __name__ == "__main__":
    sys.exit(main("recorder", run, whole=whole))
