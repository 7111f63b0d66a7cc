"""The recorder: reads every frame of the bus and writes the chosen ones to a file. Never blocks anyone."""

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
from services.runtime.process import Process, main

_RATE_HZ = 50.0


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


def run(process: Process) -> None:
    """Take what came, keep one frame in so many of each topic, write."""
    keep_every = {row.name: process.rig.recorder.keep_one_in.get(row.name, 1) for row in read_by("recorder")}
    writer = RecordingWriter(_new_file(process), _metadata(process))
    process.log.info("writing %s", writer.path)
    meter = LoopMeter(_RATE_HZ)
    process.ready(meter)
    try:
        for _tick in ticks(meter, process.stop):
            for topic, one_in in keep_every.items():
                for frame in process.bus.drain(topic):
                    if frame.sequence % one_in == 0:
                        writer.write(frame)
            writer.flush()
            process.health.gauges["recorded_frames"] = writer.frames
            process.health.change("running")
            process.health.send_if_due()
    finally:
        writer.close()
        process.log.info("%d frames in %s", writer.frames, writer.path)


if __name__ == "__main__":
    sys.exit(main("recorder", run, reads=(), reads_every=[row.name for row in read_by("recorder")]))
