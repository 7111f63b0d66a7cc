"""Recordings of other programs, and files that lie: one sentence each, and a rig starts beside them."""

from __future__ import annotations

import io
import json
import os
import re
import struct
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.writer import Writer

from tests.protocol import samples
from tests.recorder.made_up import MS, long_recording, settle
from trocar.review.attempts.recorded import assess_file
from trocar.services.cli import replay
from trocar.services.recorder import disk
from trocar.services.recorder.disk import RecordingFile
from trocar.services.recorder.recording import RecordingWriter
from trocar.services.recordings.errors import HoleError, RecordingError
from trocar.services.recordings.inputs import read_inputs
from trocar.services.recordings.reader import last_ns, read_arrays, read_extras, read_frames, read_moments
from trocar.services.recordings.repair import repair, repair_all
from trocar.services.runtime.errors import UserError
from trocar.services.training.score import load_rules

_EVERY_READER = (
    lambda path: list(read_frames(path)),
    lambda path: list(read_moments(path, ("gateway.state",))),
    lambda path: last_ns(path, ("gateway.state",)),
    read_extras,
    read_inputs,
    lambda path: assess_file(path, load_rules("mistels")),
)


def refusals(path: Path) -> set[str]:
    said = set()
    for read in _EVERY_READER:
        with pytest.raises(RecordingError) as told:
            read(path)
        assert told.value.exit_code in (5, 7)
        assert "\n" not in str(told.value)
        said.add(str(told.value).replace(f"{path.parent}/", ""))
    return said


def a_recording(path: Path, frames: int = 100, **attachments: bytes) -> Path:
    writer = RecordingWriter(path, {"rig": "stub"})
    for name, data in attachments.items():
        writer.attach(name.replace("_", "."), "application/octet-stream", data)
    for tick in range(frames):
        writer.write(msgspec.structs.replace(samples.frame("gateway.state"), sequence=tick, sent_ns=(tick + 1) * MS))
    writer.close()
    return path


def _records(path: Path, *records: tuple[Opcode, bytes]) -> Path:
    """Write a torn file of these records behind its beginning."""
    whole = a_recording(path, 0).read_bytes()
    head = whole[: 8 + 9 + struct.unpack_from("<Q", whole, 9)[0]]
    path.write_bytes(head + b"".join(struct.pack("<BQ", opcode, len(data)) + data for opcode, data in records))
    return path


def _chunk(size: int, data: bytes) -> tuple[Opcode, bytes]:
    return Opcode.CHUNK, struct.pack("<QQQII", 1, 2, size, 0, 4) + b"zstd" + struct.pack("<Q", len(data)) + data


def bomb(path: Path) -> Path:
    """A torn file of 130 kB whose last chunk becomes 4 GiB of zeros."""
    packer = zstandard.ZstdCompressor(level=1).compressobj(size=4 << 30)
    block = bytes(64 << 20)
    data = b"".join(packer.compress(block) for _ in range(64)) + packer.flush()
    return _records(path, _chunk(4 << 30, data))


@pytest.fixture(scope="module")
def bombed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = bomb(tmp_path_factory.mktemp("bomb") / "bomb.mcap")
    assert path.stat().st_size < 1 << 20
    return path


def test_a_chunk_of_four_gigabytes_in_a_small_file_is_a_sentence(bombed: Path) -> None:
    was = bombed.read_bytes()
    with pytest.raises(RecordingError, match=r"bomb\.mcap: takes more than \d+ MiB of memory to read$"):
        repair(bombed)
    with pytest.raises(RecordingError, match=r"bomb\.mcap: takes more than"):
        list(read_frames(bombed))
    assert bombed.read_bytes() == was


def test_such_a_file_keeps_no_recorder_from_mending_others(bombed: Path, tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(bombed.read_bytes())
    torn = a_recording(tmp_path / "b.mcap")
    torn.write_bytes(torn.read_bytes()[:-30])
    found = dict(repair_all(tmp_path))
    assert "takes more than" in str(found[tmp_path / "a.mcap"])
    assert getattr(found[torn], "frames", 0) == 100
    assert repair(torn) is None


def test_many_small_chunks_that_grow_cost_no_more_than_the_file_may(tmp_path: Path) -> None:
    """Of zeros: records of no kind without a length, seven millions in each."""
    zeros = bytes(64 << 20)
    chunk = _chunk(len(zeros), zstandard.ZstdCompressor().compress(zeros))
    path = _records(tmp_path / "many.mcap", *[chunk] * 16)
    with suppress(RecordingError):
        assert list(read_frames(path)) == []


@pytest.mark.parametrize(
    "opcode", [Opcode.CHUNK, Opcode.METADATA, Opcode.ATTACHMENT, Opcode.SCHEMA, Opcode.MESSAGE_INDEX]
)
def test_a_sparse_record_of_ten_gigabytes_is_a_sentence(tmp_path: Path, opcode: Opcode) -> None:
    path = _records(tmp_path / "sparse.mcap")
    with path.open("ab") as file:
        file.write(struct.pack("<BQ", opcode, 10 << 30))
        file.truncate(file.tell() + (10 << 30))
    for read in (lambda path: getattr(repair(path), "frames", 0), read_extras, lambda path: list(read_frames(path))):
        found = outcome(read, path)
        assert found in (0, ({}, {}), []) or re.fullmatch(rf"{path}: [^\n]+", str(found)), found


def outcome(read: Callable[[Path], object], path: Path) -> object:
    """Return what is read, or the sentence of the refusal."""
    try:
        return read(path)
    except RecordingError as refusal:
        return str(refusal)


def test_an_index_of_ten_gigabytes_is_a_sentence(tmp_path: Path) -> None:
    path = a_recording(tmp_path / "index.mcap")
    data = path.read_bytes()
    footer = data[-37:]
    (start,) = struct.unpack_from("<Q", footer, 9)
    with path.open("r+b") as file:
        file.truncate(start + (10 << 30))
        file.seek(0, os.SEEK_END)
        file.write(footer)
    for read in (repair, lambda path: list(read_frames(path))):
        with pytest.raises(RecordingError, match=r"index\.mcap: takes more than \d+ MiB of memory"):
            read(path)
    assert list(repair_all(tmp_path)) == []


def _foreign(path: Path, encoding: str, schema: str, topic: str, profile: str = "", library: str = "x 1.0") -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile, library)
        number = writer.register_schema(schema, "jsonschema" if encoding == "json" else "ros2msg", b"{}")
        for name in (topic, f"{topic}/again"):
            channel = writer.register_channel(name, encoding, number)
            writer.add_message(channel, 1, json.dumps({"tick": 1}).encode(), 1)
        writer.finish()
    return path


@pytest.mark.parametrize("torn", [False, True])
@pytest.mark.parametrize(
    ("encoding", "schema", "topic", "profile", "said"),
    [
        (
            "cdr",
            "tf2_msgs/msg/TFMessage",
            "/tf",
            "ros2",
            r"\(profile 'ros2'\), with /tf \(cdr tf2_msgs/msg/TFMessage\) and 1",
        ),
        ("json", "pose", "/arm", "", r"\(written by 'x 1\.0'\), with /arm \(json pose\) and 1 more"),
        ("json", "state", "/gateway/state", "", r"with /gateway/state \(json state\)"),
    ],
)
def test_a_recording_of_another_program_is_called_that(
    tmp_path: Path, encoding: str, schema: str, topic: str, profile: str, said: str, torn: bool
) -> None:
    path = _foreign(tmp_path / "other.mcap", encoding, schema, topic, profile)
    if torn:
        path.write_bytes(path.read_bytes()[:-20])
    told = refusals(path)
    assert len(told) == 1
    with pytest.raises(RecordingError, match=rf"no recording of a rig but another.*{said}"):
        list(read_frames(path))


def test_a_channel_of_another_program_among_ours_is_told(tmp_path: Path) -> None:
    path = _foreign(tmp_path / "posing.mcap", "json", "state", "/gateway/state", library="trocar")
    with pytest.raises(RecordingError, match=r"channel /gateway/state is another program's \(json, state\)"):
        list(read_frames(path))


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "a pointer of Git LFS"),
        (b"#ROSBAG V2.0\n", "a bag of ROS 1"),
        (b"SQLite format 3\0", "a database of SQLite"),
        (b"\x28\xb5\x2f\xfdrest", "packed with zstd"),
        (b"notes", "no MCAP file"),
    ],
)
def test_what_is_no_recording_is_called_what_it_is(tmp_path: Path, data: bytes, what: str) -> None:
    path = tmp_path / "some.mcap"
    path.write_bytes(data)
    (told,) = refusals(path)
    assert told.startswith(f"some.mcap: is not a recording ({what}" if what == "no MCAP file" else "some.mcap: is not")
    assert what in told


@pytest.mark.parametrize("how", ["zlib", "bomb", "cut", "pickle"])
def test_a_duct_that_cannot_be_unpacked_is_a_sentence_for_score(tmp_path: Path, how: str) -> None:
    packed = io.BytesIO()
    if how == "bomb":
        with (
            zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive,
            archive.open("vertices_m.npy", "w") as member,
        ):
            np.lib.format.write_array_header_1_0(
                member, {"descr": "<f8", "fortran_order": False, "shape": (1 << 28, 3)}
            )
            member.write(bytes(1 << 20))
    else:
        names = ("vertices_m", "triangles", "modes", "basis_hash")
        what = np.array([{}]) if how == "pickle" else np.arange(3000.0)
        np.savez_compressed(packed, **dict.fromkeys(names, what))  # type: ignore[arg-type]
    data = bytearray(packed.getvalue())
    if how == "zlib":
        data[60:200] = bytes(140)
    path = a_recording(tmp_path / "a.mcap", duct_npz=bytes(data[: len(data) // 2] if how == "cut" else data))
    with pytest.raises(UserError, match=r"a\.mcap: (duct\.npz cannot be read: |takes more than \d+ MiB)"):
        assess_file(path, load_rules("mistels"))


def test_arrays_come_without_compression_as_they_were(tmp_path: Path) -> None:
    packed = io.BytesIO()
    np.savez_compressed(packed, a=np.arange(5), b=np.array("name"))
    path = a_recording(tmp_path / "a.mcap", duct_npz=packed.getvalue())
    found = read_arrays(path, "duct.npz")
    assert found is not None
    with np.load(io.BytesIO(found), allow_pickle=False) as arrays:
        assert (arrays["a"].tolist(), str(arrays["b"])) == ([0, 1, 2, 3, 4], "name")
    assert read_arrays(path, "none.npz") is None


@pytest.mark.parametrize("scene", [None, "in\0sertion", "x" * 400, "../../etc/passwd", "a\nb", "", "/", "Übung 1.yaml"])
def test_the_scene_of_a_recording_has_a_file_whatever_its_name(tmp_path: Path, scene: str | None) -> None:
    metadata = {} if scene is None else {"scene": scene}
    path = replay._scene_file(tmp_path, metadata, {"scene.yaml": b"name: x\n"})
    assert path.parent == tmp_path
    assert path.read_bytes() == b"name: x\n"


def test_journals_of_more_ticks_than_device_frames_are_refused_before_they_are_counted(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", {})
    runs = np.tile(np.array([[0, 4096, 1, 0, 0, 0]], np.int64), (200, 1))
    for name in ("gateway.state", "haptics.journal", "physics.journal"):
        frame = samples.frame(name)
        if name.endswith("journal"):
            table = msgspec.structs.replace(frame.body.runs, shape=runs.shape, data=runs.tobytes())
            frame = msgspec.structs.replace(frame, body=msgspec.structs.replace(frame.body, noted=0, runs=table))
        writer.write(frame)
    writer.close()
    with pytest.raises(RecordingError, match=r"journal tells of 819200 ticks, 1 device frames are in it"):
        read_inputs(writer.path)


def test_on_a_full_disk_no_file_is_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four recorders started in a row, and three of them left an empty file."""
    monkeypatch.setattr(disk, "FREE_MIN", 1 << 62)
    with pytest.raises(RecordingError, match=r"a\.mcap: cannot be written: no space left on device: \d+ MB are free"):
        RecordingFile(tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_being_written_is_read_up_to_its_last_chunk(tmp_path: Path) -> None:
    writer = long_recording(tmp_path / "a.mcap", 1200)
    settle(writer)
    assert len(list(read_frames(writer.path))) == 1001
    writer.close()


def test_a_hole_is_told_with_its_exit_code(tmp_path: Path) -> None:
    path = a_recording(tmp_path / "a.mcap", scene_yaml=b"name: x\n")
    data = bytearray(path.read_bytes())
    data[data.index(b"name: x") + 1] ^= 1
    path.write_bytes(data)
    with pytest.raises(HoleError, match=r"the attachment 'scene\.yaml' is damaged"):
        read_extras(path)
