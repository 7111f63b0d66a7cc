"""Whatever ended a recording, readers that seek by index read it afterwards, up to the last chunk."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

from tests.recorder.made_up import long_recording, settle, state
from trocar.services.cli.repair import run_repair
from trocar.services.recorder.recording import RecordingWriter
from trocar.services.recordings.errors import HoleError, RecordingError
from trocar.services.recordings.reader import read_extras, read_frames
from trocar.services.recordings.repair import repair, repair_all
from trocar.services.recordings.summary import records


def ticks_by_index(path: Path) -> list[int]:
    """Return the ticks as a reader finds them that goes by the summary, and check that it is sound."""
    with path.open("rb") as file:
        reader = SeekingReader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert all(chunk.message_index_offsets for chunk in summary.chunk_indexes)
        found = [body.tick for _, _, _, body in reader.iter_decoded_messages("/gateway/state")]
        (devices,) = (number for number, channel in summary.channels.items() if channel.topic == "/gateway/state")
        assert summary.statistics.channel_message_counts[devices] == len(found)
        assert [each.name for each in reader.iter_metadata()].count("trocar") == 1
        return found


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    writer = long_recording(tmp_path_factory.mktemp("whole") / "a.mcap", 2000)
    writer.close()
    assert ticks_by_index(writer.path) == list(range(2000))
    return writer.path


def _ends_of_chunks(path: Path) -> list[int]:
    with path.open("rb") as file:
        summary = SeekingReader(file).get_summary()
    assert summary is not None
    return [chunk.chunk_start_offset + chunk.chunk_length for chunk in summary.chunk_indexes]


def _chunks(path: Path) -> list[tuple[int, int, int]]:
    with path.open("rb") as file:
        return [each for each in records(file.fileno()) if each[0] == Opcode.CHUNK]


@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0.0, 1.0))
def test_a_recording_cut_at_any_byte_is_indexed_up_to_its_last_whole_chunk(
    whole: Path, tmp_path: Path, share: float
) -> None:
    ends = _ends_of_chunks(whole)
    size = ends[0] + round(share * (whole.stat().st_size - 1 - ends[0]))
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(whole.read_bytes()[:size])
    there = [each.frame.body.tick for each in read_frames(torn)]
    found = repair(torn)
    assert found is not None
    assert found.frames == len(there) >= 2000 * (sum(end <= size for end in ends) - 1) // len(ends) > -1
    assert ticks_by_index(torn) == there == list(range(len(there)))
    assert repair(torn) is None, "it is whole now"


def test_a_last_chunk_without_its_indexes_gets_them(whole: Path, tmp_path: Path) -> None:
    with whole.open("rb") as file:
        summary = SeekingReader(file).get_summary()
    assert summary is not None
    last = summary.chunk_indexes[-1]
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(whole.read_bytes()[: last.chunk_start_offset + last.chunk_length + 5])
    repair(torn)
    assert ticks_by_index(torn) == list(range(2000))


def test_a_last_chunk_that_is_not_what_was_written_is_cut_off(whole: Path, tmp_path: Path) -> None:
    """After a power cut a file may be as long as it should be, with nothing in its last pages."""
    with whole.open("rb") as file:
        summary = SeekingReader(file).get_summary()
    assert summary is not None
    last = summary.chunk_indexes[-1]
    data = bytearray(whole.read_bytes()[: last.chunk_start_offset + last.chunk_length])
    data[last.chunk_start_offset + 200 :] = bytes(len(data) - last.chunk_start_offset - 200)
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(data)
    repair(torn)
    found = ticks_by_index(torn)
    assert found == list(range(len(found)))
    assert 1000 < len(found) < 2000


def test_a_file_of_the_library_with_what_it_declares_in_its_chunks(whole: Path, tmp_path: Path) -> None:
    torn = tmp_path / "other.mcap"
    with torn.open("wb") as file, whole.open("rb") as source:
        writer = Writer(file, chunk_size=64 * 1024)
        writer.start()
        writer.add_metadata("trocar", {})
        reader = SeekingReader(source)
        for n, (schema, _channel, message) in enumerate(reader.iter_messages()):
            assert schema is not None
            if n == 0:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channel = writer.register_channel("/gateway/state", "protobuf", number)
            writer.add_message(channel, message.log_time, message.data, message.publish_time, n)
    there = [each.frame.body.tick for each in read_frames(torn)]
    assert len(there) > 1000
    repair(torn)
    assert ticks_by_index(torn) == there


def test_what_is_no_recording_and_what_is_a_link_is_left_alone(whole: Path, tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("notes")
    (tmp_path / "link.mcap").symlink_to(whole)
    with pytest.raises(RecordingError, match="is not a recording"):
        repair(tmp_path / "text.mcap")
    with pytest.raises(RecordingError, match=r"link\.mcap: too many levels of symbolic links"):
        repair(tmp_path / "link.mcap")
    assert (tmp_path / "text.mcap").read_text() == "notes"


@pytest.mark.parametrize("opcode", [Opcode.METADATA, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK])
def test_what_is_broken_within_stays_as_it_is_and_keeps_no_recorder_from_its_start(
    whole: Path, tmp_path: Path, opcode: Opcode
) -> None:
    """What the library raised went through to the recorder, which looks at all files there when it starts."""
    broken = tmp_path / "broken.mcap"
    record = struct.pack("<BQI", opcode, 8, 4) + 4 * b"\xff"
    broken.write_bytes(whole.read_bytes()[:8] + record)
    was = broken.read_bytes()
    with pytest.raises(RecordingError, match=r"broken\.mcap: is broken within, the record at byte 8 cannot be read"):
        repair(broken)
    assert list(repair_all(tmp_path)) == []
    assert broken.read_bytes() == was


def test_what_is_being_written_is_left_alone(tmp_path: Path) -> None:
    writer = long_recording(tmp_path / "a.mcap", 1200)
    settle(writer)
    with pytest.raises(RecordingError, match="is being written"):
        repair(writer.path)
    writer.close()
    assert ticks_by_index(writer.path) == list(range(1200))


_KILLED = """
import os, sys
from pathlib import Path
from tests.recorder.made_up import long_recording, settle
settle(long_recording(Path(sys.argv[1]), 1200))
os.kill(os.getpid(), 9)
"""


def test_the_next_start_mends_what_a_killed_recorder_left(tmp_path: Path) -> None:
    killed = tmp_path / "killed.mcap"
    done = subprocess.run([sys.executable, "-c", _KILLED, str(killed)], timeout=300, check=False)
    assert done.returncode == -9
    open_one = long_recording(tmp_path / "open.mcap", 10)
    (tmp_path / "text.mcap").write_text("notes")
    assert {path: found.frames for path, found in repair_all(tmp_path)} == {killed: 1001}
    assert ticks_by_index(killed) == list(range(1001))
    assert list(repair_all(tmp_path)) == []
    open_one.close()
    assert os.path.getsize(tmp_path / "text.mcap") == 5


def test_the_command_says_what_it_did(whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(whole.read_bytes()[:-100])
    run_repair([torn, torn], as_json=False)
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith(f"{torn}: indexed anew, 2000 frames; ")
    assert second == f"{torn}: is whole"
    run_repair([torn], as_json=True)
    assert capsys.readouterr().out == f'{{"file": "{torn}", "mended": false}}\n'


@pytest.mark.parametrize("torn", [False, True])
@pytest.mark.parametrize("number", [0, 1, -2])
def test_a_flipped_bit_in_any_chunk_is_told_with_its_place(
    whole: Path, tmp_path: Path, number: int, torn: bool
) -> None:
    damaged = tmp_path / "damaged.mcap"
    data = bytearray(whole.read_bytes())
    ends = _ends_of_chunks(whole)
    data[ends[number] - 50] ^= 1
    damaged.write_bytes(data[: -30 if torn else len(data)])
    with pytest.raises(
        HoleError, match=rf"1 of {len(ends)} chunks are damaged, \d+ frames between .* s cannot"
    ) as told:
        repair(damaged)
    assert told.value.exit_code == 7
    if not torn:
        assert damaged.read_bytes() == data, "what is damaged stays as it is"
        read: list[int] = []
        with pytest.raises(HoleError, match=r"is damaged.*trocar repair"):
            read.extend(each.frame.body.tick for each in read_frames(damaged))
        assert read == list(range(len(read))), "numbers were read that nobody wrote"
    assert repair(damaged, every_chunk=False) is None, "its end is mended"


def _explained(path: Path) -> dict[str, tuple[int, int]]:
    """Record with what explains it, and return by kind of record where it begins and ends."""
    writer = RecordingWriter(path, {"rig": "left"})
    writer.attach("scene.yaml", "application/yaml", b"name: narrow\n")
    for sequence in range(100):
        writer.write(state(sequence))
    writer.close()
    file = os.open(path, os.O_RDONLY)
    try:
        return {Opcode(opcode).name: (begin, end) for opcode, begin, end in records(file)}
    finally:
        os.close(file)


def _flip(path: Path, byte: int) -> None:
    data = bytearray(path.read_bytes())
    data[byte] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize("torn", [False, True])
def test_a_flipped_bit_in_an_attachment_is_told_and_the_attachment_not_read(tmp_path: Path, torn: bool) -> None:
    """A scene of other numbers would be replayed, and nobody would know."""
    path = tmp_path / "a.mcap"
    end = _explained(path)["ATTACHMENT"][1]
    assert read_extras(path)[1] == {"scene.yaml": b"name: narrow\n"}
    _flip(path, end - 8)
    if torn:
        path.write_bytes(path.read_bytes()[:-30])
    for read in (repair, read_extras):
        with pytest.raises(HoleError, match=r"a\.mcap: the attachment 'scene\.yaml' is damaged"):
            read(path)
    assert [each.frame.body.tick for each in read_frames(path)] == list(range(100))


@pytest.mark.parametrize("kind", ["METADATA", "MESSAGE_INDEX", "SCHEMA"])
def test_a_flipped_bit_beside_the_chunks_is_told(tmp_path: Path, kind: str) -> None:
    """Such records have no checksum of their own, but the whole of them has."""
    path = tmp_path / "a.mcap"
    end = _explained(path)[kind][1]
    assert repair(path) is None
    _flip(path, end - 3)
    with pytest.raises(HoleError, match=r"a\.mcap: what describes it .* is damaged"):
        repair(path)


def test_a_length_that_leads_astray_is_told(tmp_path: Path) -> None:
    """The walk over the records ended there, and what it had seen was called whole."""
    path = tmp_path / "a.mcap"
    _flip(path, _explained(path)["METADATA"][0] - 7)
    with pytest.raises(RecordingError, match="is broken within"):
        repair(path)
    with pytest.raises(HoleError, match=r"is damaged; `trocar repair`"):
        read_extras(path)


def test_a_checksum_goes_with_what_was_cut_off_behind_it(tmp_path: Path) -> None:
    """A footer that is torn leaves it; a last chunk that is indexed anew makes it another file."""
    path = tmp_path / "a.mcap"
    end = _explained(path)["MESSAGE_INDEX"][1]
    whole = path.read_bytes()
    for size in (len(whole) - 30, end - 1):
        path.write_bytes(whole[:size])
        assert repair(path) is not None
        assert repair(path) is None
    path.write_bytes(whole[:-30])
    repair(path)
    _flip(path, end - 3)
    with pytest.raises(HoleError, match="what describes it"):
        repair(path)


def test_a_flipped_bit_in_the_index_costs_nothing(whole: Path, tmp_path: Path) -> None:
    """All chunks are there: they are read one after the other."""
    damaged = tmp_path / "damaged.mcap"
    data = bytearray(whole.read_bytes())
    data[-200] ^= 1
    damaged.write_bytes(data)
    assert [each.frame.body.tick for each in read_frames(damaged)] == list(range(2000))


def test_a_flipped_bit_anywhere_in_the_index_is_found_and_the_index_made_anew(tmp_path: Path) -> None:
    """Such a file was called whole, while other readers could not read it."""
    path = tmp_path / "a.mcap"
    whole = long_recording(path, 300)
    whole.close()
    data = path.read_bytes()
    summary, _offsets = struct.unpack_from("<QQ", data, len(data) - 28)
    random = np.random.default_rng(8)
    for place in random.integers(summary, len(data) - 8, 40):
        path.write_bytes(data)
        _flip(path, int(place))
        repaired = repair(path)
        assert repaired is not None, place
        assert repaired.cut_bytes == 0 or place >= len(data) - 37
        assert ticks_by_index(path) == list(range(300))
        assert repair(path) is None


def test_a_damaged_last_chunk_stays_where_the_index_is_damaged_too(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    whole = long_recording(path, 300)
    whole.close()
    size, (*_, (_, begin, end)) = path.stat().st_size, _chunks(path)
    _flip(path, (begin + end) // 2)
    _flip(path, size - 20)
    with pytest.raises(HoleError, match="chunks are damaged"):
        repair(path)
    assert path.stat().st_size == size
