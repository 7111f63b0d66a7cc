"""Reading recordings: the bodies of the bus, in the order of sending.

Another process reads the file, with limits, and sends frames of the wire, which are checked as those of the bus are.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from trocar.protocol import TOPICS, Frame, FrameError, decode
from trocar.services.foreign_files import Refusal, ask, ask_once
from trocar.services.recordings.errors import HoleError, RecordingError, UnopenedError

_MODULE = "trocar.services.recordings.foreign"
#: Kinds of refusals that go on as what they were.
_KINDS: dict[str, type[RecordingError]] = {kind.__name__: kind for kind in (HoleError, UnopenedError)}
_frames = msgspec.msgpack.Decoder(list[tuple[str, int, bytes]])
_moments = msgspec.msgpack.Decoder(list[tuple[bytes, ...]])
_metadata = msgspec.json.Decoder(dict[str, dict[str, str]])
_time = msgspec.json.Decoder(int)


@dataclass(frozen=True, slots=True)
class RecordedFrame:
    """A frame of the bus, and its wall-clock time of sending."""

    time_ns: int
    frame: Frame


def read_messages(path: Path, topics: Collection[str] = ()) -> Iterator[tuple[str, int, Any]]:
    """Yield ``(topic, time_ns, body)`` of the messages of a recording by time, as `read_frames` does.

    `body` has the same type as on the bus, so the same code works live and on files.
    """
    for each in read_frames(path, topics):
        yield each.frame.topic, each.time_ns, each.frame.body


def read_frames(path: Path, topics: Collection[str] = (), from_ns: int = 0) -> Iterator[RecordedFrame]:
    """Yield the frames of a recording by their time of sending.

    A truncated file ends after its last whole chunk. Bodies of former versions are converted to the present one.
    Raises RecordingError: one sentence, if it is no recording, or a message does not fit its topic; HoleError at a
    damaged part, after yielding the frames before it.

    Args:
        path: Path of the file.
        topics: Names of the bus topics to read; empty for all.
        from_ns: Wall-clock time of the first frame to read.
    """
    with told(path):
        for message in ask(_MODULE, "frames", path, topics=list(topics or TOPICS), from_ns=from_ns):
            for topic, time_ns, data in _frames.decode(message):
                yield RecordedFrame(time_ns, decode(data, topic, used=False))


def read_moments(path: Path, topics: Sequence[str]) -> Iterator[tuple[Any, ...]]:
    """Yield the newest body of each topic at each message of the last topic, once there is one of each.

    Only yielded bodies are decoded, so that messages between two of the last topic cost next to nothing.
    Raises as `read_frames` does.
    """
    with told(path):
        for message in ask(_MODULE, "moments", path, topics=list(topics)):
            for moment in _moments.decode(message):
                yield tuple(decode(data, name, used=False).body for name, data in zip(topics, moment, strict=True))


def last_ns(path: Path, topics: Collection[str]) -> int:
    """Return the time of the last message of some topics, 0 without one; raises as `read_frames` does."""
    with told(path):
        (message,) = ask_once(_MODULE, "last_ns", path, topics=list(topics))
        return _time.decode(message)


def read_extras(path: Path) -> tuple[dict[str, dict[str, str]], dict[str, bytes]]:
    """Return metadata and attachments of a recording by name, the last of two with one name.

    Raises RecordingError if it is no recording, HoleError if an attachment is damaged.
    """
    with told(path):
        metadata, *rest = ask_once(_MODULE, "extras", path)
        names = [name.decode() for name in rest[::2]]
        return _metadata.decode(metadata), dict(zip(names, rest[1::2], strict=True))


def read_arrays(path: Path, name: str) -> bytes | None:
    """Return an attachment of arrays as an npz file without compression, which takes no more memory than it has bytes.

    None if the recording has none of that name. Raises RecordingError if it cannot be unpacked.
    """
    with told(path):
        return next(iter(ask_once(_MODULE, "arrays", path, name=name)), None)


@contextmanager
def told(path: Path) -> Iterator[None]:
    """Raise RecordingError, or the kind of it that a reader raised, for what it refuses or has sent unasked."""
    try:
        yield
    except Refusal as refusal:
        raise _KINDS.get(refusal.kind, RecordingError)(str(refusal)) from refusal
    except FrameError as error:
        raise RecordingError(f"{path}: a message in it is not as the bus has them: {error}") from error
