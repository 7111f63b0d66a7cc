"""The recorder: every frame of the devices and samples of all else, from the bus to a file. Never blocks anyone."""

from __future__ import annotations

import platform
import sys
import time
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from protocol.topics import read_by
from services.recorder.recording import RecordingWriter
from services.runtime.loop import LoopMeter, ticks
from services.runtime.process import Process, ProcessConfig, main
from services.runtime.rig import Rig

#: Longer than the period of what is sampled, far shorter than a turn.
_PATIENCE_NS = 4_000_000


def _new_file(process: Process) -> Path:
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    return process.rig.recorder.directory / f"{process.rig.name}-{stamp}-{time.monotonic_ns() % 10**6:06d}.mcap"


def _metadata(process: Process) -> dict[str, str]:
    return {
        "rig": process.rig.name,
        "scene": process.scene_name,
        "host": platform.node(),
        "trocar": version("trocar"),
        "rig_file": process.rig.model_dump_json(),
    }


def topics(process_config: ProcessConfig) -> dict[str, tuple[str, ...]]:
    """Return how the topics are read: whole, or sampled."""
    whole = process_config.rig.recorder.whole
    return {"reads": (), "reads_every": whole, "samples": _sampled(process_config.rig)}


def _sampled(rig: Rig) -> tuple[str, ...]:
    return tuple(row.name for row in read_by("recorder") if row.name not in rig.recorder.whole)


def run(process: Process) -> None:
    """Write what came whole, then one frame of everything else."""
    bus, settings = process.bus, process.rig.recorder
    sampled = _sampled(process.rig)
    writer = RecordingWriter(_new_file(process), _metadata(process))
    process.log.info("writing %s", writer.path)
    meter = LoopMeter(settings.sample_rate_hz)
    process.ready(meter)
    try:
        for _tick in ticks(meter, process.stop):
            frames = [frame for topic in settings.whole for frame in bus.drain(topic)]
            frames += bus.sample(sampled, time.monotonic_ns() + _PATIENCE_NS).values()
            for frame in frames:
                writer.write(frame)
            writer.flush()
            process.health.gauges["recorded_frames"] = writer.frames
            process.health.change("running")
            process.health.send_if_due()
    finally:
        writer.close()
        process.log.info("%d frames in %s", writer.frames, writer.path)


if __name__ == "__main__":
    sys.exit(main("recorder", run, topics=topics))
