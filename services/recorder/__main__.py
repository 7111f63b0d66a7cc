"""The recorder: every frame of the devices and samples of all else, from the bus to a file. Never blocks anyone."""

from __future__ import annotations

import platform
import sys
import time
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from protocol.topics import observed_by, read_by
from services.recorder.recording import RecordingWriter
from services.runtime.loop import LoopMeter, ticks
from services.runtime.process import Process, ProcessConfig, main

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


def whole(process_config: ProcessConfig) -> tuple[str, ...]:
    """Return the topics of which the rig file wants every frame."""
    return process_config.rig.recorder.whole


def run(process: Process) -> None:
    """Write what came, then one frame of everything that is sampled."""
    bus, settings = process.bus, process.rig.recorder
    read = dict.fromkeys((*settings.whole, *read_by("recorder")))
    sampled = [topic for topic in observed_by("recorder") if topic not in read]
    writer = RecordingWriter(_new_file(process), _metadata(process))
    process.log.info("writing %s", writer.path)
    meter = LoopMeter(settings.sample_rate_hz)
    process.ready(meter)
    try:
        for _tick in ticks(meter, process.stop):
            frames = [frame for topic in read for frame in bus.drain(topic)]
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
    sys.exit(main("recorder", run, whole=whole))
