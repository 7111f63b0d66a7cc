"""Recordings of so many frames, a millisecond apart."""

from __future__ import annotations

import time
from pathlib import Path

import msgspec
import numpy as np

from tests.protocol import samples
from trocar.protocol import Frame
from trocar.services.recorder.recording import RecordingWriter

MS = 1_000_000


def state(sequence: int) -> Frame:
    """Return a device frame with numbers that do not compress."""
    frame = samples.frame("gateway.state")
    chance = np.random.default_rng(sequence).standard_normal(3)
    instrument = msgspec.structs.replace(frame.body.instruments[0], position_m=tuple(chance.tolist()))
    body = msgspec.structs.replace(frame.body, tick=sequence, instruments=(instrument,))
    return msgspec.structs.replace(frame, sequence=sequence, sent_ns=sequence * MS, body=body)


def long_recording(path: Path, frames: int) -> RecordingWriter:
    """Return an open recording: a chunk every half second, the last half second still in memory."""
    writer = RecordingWriter(path, {})
    for sequence in range(frames):
        writer.write(state(sequence))
        if sequence % 500 == 0:
            writer.end_old_chunk((sequence + 1) * 2 * MS)
    return writer


def settle(writer: RecordingWriter) -> None:
    """Wait until the disk has what it was handed."""
    deadline = time.monotonic() + 60.0
    while writer.pending_bytes:
        assert time.monotonic() < deadline
        time.sleep(1e-3)
