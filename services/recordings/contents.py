"""Reading the contents of recordings, wherever they are from. Called in a reader process: see `foreign`."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Channel, DataEnd, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

from trocar.services.foreign_files.known_kinds import find_known_kind
from trocar.services.recordings.channels import channel_name
from trocar.services.recordings.errors import HoleError, RecordingError, UnopenedError
from trocar.services.recordings.schema import PACKAGE
from trocar.services.recordings.summary import has_sound_index, is_closed, is_sound, record_stream, records

#: Exceptions of the libraries for truncated or inconsistent records.
BROKEN = (McapError, EOFError, ValueError, OverflowError, struct.error, zstandard.ZstdError, zlib.error, KeyError)

_DAMAGED = "{}: is damaged; `trocar repair` says how much of it cannot be read"
_HEAD_BYTES = 4096  # enough for every mark of a known kind
_MAGIC = b"\x89MCAP0"


@contextmanager
def opened(path: Path) -> Iterator[IO[bytes]]:
    """Open a recording for reading.

    Raises RecordingError if there is no such file, or it is no MCAP file, or another program's.
    """
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
            if not head.startswith(_MAGIC):
                known = find_known_kind(head)
                raise RecordingError(f"{path}: is not a recording ({known or 'no MCAP file'})")
            file.seek(0)
            _judge_origin(path, file)
            file.seek(0)
            yield file
    except OSError as error:
        raise UnopenedError(f"{path}: {(error.strerror or str(error)).lower()}") from None


def _judge_origin(path: Path, file: IO[bytes]) -> None:
    """Refuse a recording that has channels, and none of this program's.

    Raises RecordingError that says whose it is, and what it holds.
    """
    library, profile, foreign = "", "", dict[str, str]()
    schemas: dict[int, Schema] = {}
    with suppress(*BROKEN):
        for record in _declarations(file):
            if isinstance(record, Header):
                library, profile = record.library, record.profile
                if library == "trocar":
                    return
            elif isinstance(record, Schema):
                schemas[record.id] = record
            else:
                schema = schemas.get(record.schema_id)
                if _is_ours(record, schema):
                    return
                kind = " ".join(each for each in (record.message_encoding, schema.name if schema else "") if each)
                foreign[record.topic] = kind
    if foreign:
        whose = f"profile {profile!r}" if profile else f"written by {library!r}" if library else "of another program"
        others = f" and {len(foreign) - 1} more" if len(foreign) > 1 else ""
        topic, kind = next(iter(foreign.items()))
        raise RecordingError(
            f"{path}: is no recording of a rig but another program's ({whose}), with {topic} ({kind}){others}"
        )


def _declarations(file: IO[bytes]) -> Iterator[Header | Schema | Channel]:
    """Yield the header, and then each schema before the channels of it."""
    if is_closed(file.fileno()) and has_sound_index(file.fileno()):
        reader = SeekingReader(file)
        yield reader.get_header()
        summary = reader.get_summary()
        if summary is not None and summary.channels:
            yield from summary.schemas.values()
            yield from summary.channels.values()
            return
    file.seek(0)
    for record in StreamReader(file).records:
        if isinstance(record, Header | Schema | Channel):
            yield record


def _is_ours(channel: Channel, schema: Schema | None) -> bool:
    named = schema is not None and schema.name.startswith(f"{PACKAGE}.")
    return named and channel.message_encoding == "protobuf"


def last_ns(path: Path, topics: Collection[str]) -> int:
    """Return the time of the last message of some topics, 0 without one; raises as `read_messages` does."""
    return max((message.log_time for _, message in read_messages(path, topics)), default=0)


def read_messages(path: Path, topics: Collection[str], from_ns: int = 0) -> Iterator[tuple[str, Message]]:
    """Yield topics and messages by time, using a valid index or else reading all messages first.

    Raises HoleError at a damaged part of a closed file.
    """
    wanted = {channel_name(name): name for name in topics}
    with opened(path) as file:
        closed = is_closed(file.fileno())
        try:
            if closed and has_sound_index(file.fileno()):
                judged = set[int]()
                reader = SeekingReader(file, validate_crcs=True)
                for schema, channel, message in reader.iter_messages(list(wanted), starting_at=from_ns):
                    if channel.id not in judged:
                        _judge_channel(path, channel, schema)
                        judged.add(channel.id)
                    yield wanted[channel.topic], message
                return
            found: list[tuple[str, Message]] = []
            with suppress(*(() if closed else BROKEN)):
                found.extend(_records(path, file, wanted))
        except BROKEN:
            raise HoleError(_DAMAGED.format(path)) from None
    yield from sorted((each for each in found if each[1].log_time >= from_ns), key=lambda each: each[1].log_time)


def _judge_channel(path: Path, channel: Channel, schema: Schema | None) -> None:
    if not _is_ours(channel, schema):
        kind = f"{channel.message_encoding or 'no encoding'}, {schema.name if schema else 'no schema'}"
        raise RecordingError(f"{path}: its channel {channel.topic} is another program's ({kind})")


def _records(path: Path, file: IO[bytes], wanted: Mapping[str, str]) -> Iterator[tuple[str, Message]]:
    """Yield topics and messages of wanted channels in the file's order."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    judged = set[int]()
    for record in StreamReader(file, validate_crcs=True).records:
        if isinstance(record, DataEnd):
            return
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.topic in wanted:
            channels[record.id] = record
        elif isinstance(record, Message) and record.channel_id in channels:
            channel = channels[record.channel_id]
            if channel.id not in judged:
                _judge_channel(path, channel, schemas.get(channel.schema_id))
                judged.add(channel.id)
            yield wanted[channel.topic], record


def read_extras(path: Path) -> tuple[dict[str, dict[str, str]], dict[str, bytes]]:
    """Return metadata and attachments of a recording by name, the last of two with one name.

    Raises RecordingError if it is no recording, HoleError if an attachment is damaged.
    """
    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, bytes] = {}
    with opened(path) as file:
        number, opcode = file.fileno(), 0
        try:
            for opcode, begin, end in records(number):
                if opcode == Opcode.METADATA:
                    record = Metadata.read(record_stream(os.pread(number, end - begin, begin)))
                    metadata[record.name] = record.metadata
                elif opcode == Opcode.ATTACHMENT:
                    content = os.pread(number, end - begin, begin)
                    attachment = Attachment.read(record_stream(content))
                    if not is_sound(content):
                        raise HoleError(f"{path}: the attachment {attachment.name!r} is damaged")
                    attachments[attachment.name] = attachment.data
        except BROKEN:
            opcode = 0
        if opcode != Opcode.DATA_END and is_closed(number):
            raise HoleError(_DAMAGED.format(path))
    return metadata, attachments
