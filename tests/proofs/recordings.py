"""Recordings that are cut, or of which one bit is flipped: nothing false is read, nothing is lost in silence."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.reader import SeekingReader

from tests.proofs.trials import Found, Proof, Try
from tests.recorder.made_up import long_recording
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.reader import read_extras, read_frames
from trocar.services.recordings.repair import repair

#: A recording whose attachment is a third of it.
FRAMES, ATTACHED = 2_000, 70_000


@dataclass(frozen=True, slots=True)
class Original:
    """A whole recording.

    Attributes:
        data: Its bytes.
        frames: Times and bodies.
        extras: Metadata and attachments.
        until: Of each chunk: where it ends, and how many frames were written up to there.
    """

    data: bytes
    frames: list[tuple[int, object]]
    extras: tuple[dict[str, dict[str, str]], dict[str, bytes]]
    until: list[tuple[int, int]]


def original(folder: Path) -> Original:
    """Record, and read all."""
    writer = long_recording(folder / "whole.mcap", FRAMES)
    writer.attach("scene.npz", "application/x-npz", np.random.default_rng(1).bytes(ATTACHED))
    writer.close()
    with writer.path.open("rb") as file:
        summary = SeekingReader(file).get_summary()
    assert summary is not None
    frames = _read(writer.path)
    until = [
        (chunk.chunk_start_offset + chunk.chunk_length, sum(ns <= chunk.message_end_time for ns, _ in frames))
        for chunk in summary.chunk_indexes
    ]
    return Original(writer.path.read_bytes(), frames, read_extras(writer.path), until)


def _read(path: Path) -> list[tuple[int, object]]:
    return [(each.time_ns, each.frame.body) for each in read_frames(path)]


def judge_cut(whole: Original, size: int, path: Path) -> str:
    """Return what is wrong with a recording of so many bytes, read and mended."""
    path.write_bytes(whole.data[:size])
    try:
        before = _read(path)
        repair(path)
        after = _read(path)
    except RecordingError:
        return "" if size < whole.until[0][0] else "what has whole chunks was refused"
    there = max((count for end, count in whole.until if end <= size), default=0)
    if not before == after == whole.frames[: len(after)]:
        return "other frames were read than were written, or others once it was mended"
    return "" if len(after) >= there else "whole chunks were lost"


def judge_flip(whole: Original, bit: int, path: Path) -> str:
    """Return what is wrong with a recording whose bit is another, read and mended."""
    data = bytearray(whole.data)
    data[bit // 8] ^= 1 << bit % 8
    path.write_bytes(data)
    is_told, read, (metadata, attachments) = False, [], ({}, {})
    try:
        repair(path)
    except RecordingError:
        is_told = True
    try:
        read = _read(path)
        metadata, attachments = read_extras(path)
    except RecordingError:
        is_told = True
    if any(each not in whole.frames for each in read):
        return "a frame was read that was never written"
    if any(whole.extras[1].get(name) != data for name, data in attachments.items()):
        return "an attachment was read that was never written"
    if not is_told and (metadata, attachments) != whole.extras:
        return "what describes the recording changed in silence"
    return "" if is_told or read == whole.frames else f"{len(whole.frames) - len(read)} frames were lost in silence"


def _proof(name: str, cases: str, asked: int, holds: str, places: int, judge: Callable[..., str]) -> Proof:
    @contextmanager
    def begin() -> Iterator[Try]:
        with tempfile.TemporaryDirectory() as folder:
            whole, path = original(Path(folder)), Path(folder) / "damaged.mcap"

            def try_once(chance: np.random.Generator) -> Found:
                at = int(chance.integers(places * len(whole.data)))
                why = judge(whole, at, path)
                return Found(failed=int(bool(why)), why=(f"{at}: {why}",) if why else (), figures={"at": at})

            yield try_once

    return Proof(name, cases, asked, holds, begin)


CUTS = _proof("cuts", "recordings cut", 100, "whole chunks are read", 1,
              judge_cut)  # fmt: skip
FLIPS = _proof("flips", "recordings, a bit flipped", 300, "read as written, or reported",
               8, judge_flip)  # fmt: skip
