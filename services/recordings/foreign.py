"""What is run in another process: recordings of any origin, to frames of the wire."""

from __future__ import annotations

import io
import json
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from google.protobuf.message import DecodeError

from trocar.protocol import Frame, encode
from trocar.services.recordings import contents
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.mending import mend
from trocar.services.recordings.transcode import to_frame

#: Of messages that are sent together, half a packet, as a single one sends its own cost; the first of all is sent at
#: once.
_TOGETHER_BYTES = 1 << 15


def frames(path: str, topics: Collection[str], from_ns: int) -> Iterator[bytes]:
    """Yield lists of topic, time and frame (msgpack); raises as `contents.read_messages` does."""
    place = Path(path)
    return _together(
        (topic, message.log_time, encode(_frame(place, topic, message.data)))
        for topic, message in contents.read_messages(place, topics, from_ns)
    )


def moments(path: str, topics: Sequence[str]) -> Iterator[bytes]:
    """Yield lists of the newest frame of each topic, at each message of the last one; only these are decoded."""
    return _together(_moments(Path(path), topics))


def _moments(path: Path, topics: Sequence[str]) -> Iterator[tuple[bytes, ...]]:
    newest: dict[str, bytes] = {}
    for topic, message in contents.read_messages(path, topics):
        newest[topic] = message.data
        if topic == topics[-1] and len(newest) == len(set(topics)):
            yield tuple(encode(_frame(path, name, newest[name])) for name in topics)


def _frame(path: Path, topic: str, data: bytes) -> Frame:
    try:
        return to_frame(topic, data)
    except (ValueError, DecodeError) as error:
        raise RecordingError(f"{path}: a message of {topic} cannot be read: {error}") from None


def _together(items: Iterator[tuple[Any, ...]]) -> Iterator[bytes]:
    """Yield lists of items; where they end by an exception, those before it come first."""
    batch: list[tuple[Any, ...]] = []
    size, limit = 0, 0
    try:
        for item in items:
            batch.append(item)
            size += len(item[-1]) * len(item)
            if size > limit:
                yield msgspec.msgpack.encode(batch)
                batch, size, limit = [], 0, _TOGETHER_BYTES
    except Exception:
        yield msgspec.msgpack.encode(batch)
        raise
    yield msgspec.msgpack.encode(batch)


def last_ns(path: str, topics: Collection[str]) -> Iterator[bytes]:
    """Yield the time of the last message (JSON)."""
    yield json.dumps(contents.last_ns(Path(path), topics)).encode()


def extras(path: str) -> Iterator[bytes]:
    """Yield metadata by name (JSON), then name and content of each attachment."""
    metadata, attachments = contents.read_extras(Path(path))
    yield json.dumps(metadata).encode()
    for name, data in attachments.items():
        yield name.encode()
        yield data


def arrays(path: str, name: str) -> Iterator[bytes]:
    """Yield an attachment of arrays (npz) as it is without compression; nothing if there is none of that name.

    Raises RecordingError if it cannot be unpacked.
    """
    attachment = contents.read_extras(Path(path))[1].get(name)
    if attachment is None:
        return
    try:
        with np.load(io.BytesIO(attachment), allow_pickle=False) as packed:
            unpacked = {each: packed[each] for each in packed.files}
    except MemoryError:
        raise
    except Exception as error:  # zipfile, zlib and numpy raise whatever a broken file trips them over
        raise RecordingError(f"{path}: {name} cannot be read: {error}") from None
    file = io.BytesIO()
    np.savez(file, **unpacked)
    yield file.getvalue()


def repair(path: str, every_chunk: bool) -> Iterator[bytes]:
    """Yield what a repair has done (JSON), null for nothing; raises as `mending.mend` does."""
    yield msgspec.json.encode(mend(Path(path), every_chunk))
