"""A full disk, a slow disk, and other users."""

from __future__ import annotations

import errno
import gc
import itertools
import resource
import subprocess
import sys
import threading
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.records import ChunkIndex

from tests.other_user import as_other_user, everybodys, needs_other_user
from tests.physics.conftest import SMALL
from tests.protocol import samples
from tests.recorder.made_up import MS, long_recording, settle, state
from tests.recorder.test_losses import Stub
from tests.recorder.test_repair import ticks_by_index
from trocar.protocol import TOPICS
from trocar.services.recorder import disk, recording
from trocar.services.recorder.__main__ import Recording
from trocar.services.recorder.recording import RecordingWriter
from trocar.services.recordings.chunks import OpenChunk
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.summary import StoredEntries
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import Transport

__all__ = ["everybodys"]


@pytest.fixture
def room() -> Iterator[None]:
    """Files of this process may not grow beyond 110 kB: what they are refused is what a full disk refuses."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (110_000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.usefixtures("room")
def test_on_a_full_disk_what_was_written_is_readable_by_index(tmp_path: Path) -> None:
    writer = long_recording(tmp_path / "a.mcap", 2001)
    settle(writer)
    with pytest.raises(RecordingError, match=r"a\.mcap: file too large") as caught:
        writer.end_old_chunk(9000 * MS)
    assert caught.value.exit_code != 0
    with pytest.raises(RecordingError, match="frames were kept"):
        writer.close()
    found = ticks_by_index(writer.path)
    assert found == list(range(len(found)))
    assert len(found) > 400
    assert writer.path.stat().st_size <= 110_000


def test_an_index_that_finds_no_room_ends_the_file_before_its_chunk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is indexed lies in a file of its own, which may be the first to be refused."""
    append = StoredEntries.append

    def full(entries: StoredEntries, chunk: ChunkIndex, /) -> None:
        if len(entries) == 3:
            raise OSError(errno.ENOSPC, "no space left")
        append(entries, chunk)

    monkeypatch.setattr(StoredEntries, "append", full)
    writer = long_recording(tmp_path / "a.mcap", 1600)
    with pytest.raises(RecordingError, match=r"no space left; 1501 frames were kept"):
        writer.close()
    assert ticks_by_index(writer.path) == list(range(1501))
    with writer.path.open("rb") as file:
        assert sum(1 for _ in NonSeekingReader(file).iter_messages()) == 1501, "and nothing else lies in it"


def test_memory_does_not_grow_with_the_length_of_a_recording(tmp_path: Path) -> None:
    """By 11 MB an hour it did, as the objects of the index were kept: 1.6 kB for each chunk of 16 channels."""
    recorder = Recording(Stub(tmp_path))  # type: ignore[arg-type]
    frames = [samples.frame(name) for name in TOPICS]
    now_ns = recorder._due_ns
    tracemalloc.start()
    try:
        held = []
        for chunks in (100, 500):
            for _ in range(chunks):
                now_ns += 501 * MS
                recorder.append_frames(msgspec.structs.replace(frame, sent_ns=now_ns) for frame in frames)
                recorder.write_due(now_ns)
            settle(recorder._writer)
            gc.collect()
            held.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    recorder.close()
    assert held[1] - held[0] < 64 * 500, "64 bytes a chunk, half a megabyte an hour"
    with recorder._writer.path.open("rb") as file:
        summary = SeekingReader(file, validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert len(summary.chunk_indexes) == summary.statistics.chunk_count == 600
    assert summary.statistics.message_count > 600 * len(frames)


def test_a_disk_that_is_full_from_the_start_is_a_sentence_and_leaves_nothing(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8, hard))
    try:
        with pytest.raises(RecordingError, match="cannot be written: file too large"):
            RecordingWriter(tmp_path / "a.mcap", {})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not list(tmp_path.iterdir())


_LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, 600_000))
from trocar.services.recorder.__main__ import main, run, whole
sys.exit(main("recorder", run, sys.argv[1:], whole=whole))
"""


def test_the_process_ends_with_a_sentence_and_an_exit_code_and_its_publishers_go_on(tmp_path: Path) -> None:
    bus = ZmqBus(Transport(directory=tmp_path / "bus"), publishes=["gateway.state"])
    rig = {
        "name": "full", "scene": str(SMALL), "transport": {"directory": str(tmp_path / "bus")},
        "recorder": {"directory": str(tmp_path / "rec")},
    }  # fmt: skip
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    command = [sys.executable, "-c", _LIMITED, "--rig", str(tmp_path / "rig.yaml")]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        deadline = time.monotonic() + 200.0
        sent = itertools.count()
        while process.poll() is None:
            assert time.monotonic() < deadline
            bus.publish("gateway.state", state(next(sent)).body)
            bus.has_reader("gateway.state")
            time.sleep(5e-4)
    finally:
        process.kill()
        last = process.communicate()[1].splitlines()[-1]
        bus.close()
    (path,) = (tmp_path / "rec").iterdir()
    assert process.returncode == RecordingError.exit_code
    assert last.startswith(f"recorder: {path}: file too large; ")
    found = ticks_by_index(path)
    assert len(found) > 100
    assert found == list(range(found[0], found[-1] + 1)), "nothing is missing up to there"


def test_frames_that_a_slow_disk_leaves_no_room_for_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk stands still: what is handed over waits, up to a limit; then frames are lost, and counted."""
    goes_on, close = threading.Event(), OpenChunk.close
    monkeypatch.setattr(OpenChunk, "close", lambda self, offset: goes_on.wait(600.0) and close(self, offset))
    monkeypatch.setattr(recording, "PENDING_MAX", 300_000)
    writer = long_recording(tmp_path / "a.mcap", 4000)
    lost = writer.lost["gateway.state"]
    assert 0 < lost < 4000
    assert writer.frames == 4000 - lost
    goes_on.set()
    settle(writer)
    writer.write(state(4000))
    assert writer.lost["gateway.state"] == lost, "the disk goes on, and so does the recording"
    writer.close()
    assert len(ticks_by_index(writer.path)) == 4001 - lost


def test_a_write_that_the_disk_holds_is_told_while_it_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    stub: Any = Stub(tmp_path)
    recorder = Recording(stub)
    settle(recorder._writer)
    goes_on, write_at = threading.Event(), disk.write_at
    monkeypatch.setattr(disk, "write_at", lambda *arguments: goes_on.wait(600.0) and write_at(*arguments))
    recorder._writer.write(state(0))
    recorder._writer.end_old_chunk(10**18)
    deadline = time.monotonic() + 60.0
    while stub.health.state != "degraded":
        assert time.monotonic() < deadline
        recorder.sleep_until(time.monotonic_ns() + 5 * MS)
    for _ in range(5):
        recorder.look_at_disk()
    assert stub.health.detail.startswith("the disk has held a write for ")
    assert caplog.text.count("the disk has held a write for ") == 1, "once, however long it lasts"
    goes_on.set()
    settle(recorder._writer)
    assert recorder._writer.held_s() == 0.0
    recorder.write_due(recorder._due_ns)
    assert stub.health.state == "running"
    recorder.close()


def test_the_disk_is_looked_at_often_only_while_something_waits_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recording(Stub(tmp_path))  # type: ignore[arg-type]
    settle(recorder._writer)
    looks: list[int] = []
    monkeypatch.setattr(recorder, "look_at_disk", lambda: looks.append(1))
    clock_ns = [0]
    monkeypatch.setattr(time, "monotonic_ns", lambda: clock_ns[0])
    monkeypatch.setattr(time, "sleep", lambda seconds: clock_ns.append(clock_ns.pop() + round(1e9 * seconds)))
    recorder.sleep_until(40 * MS)
    assert (len(looks), clock_ns) == (1, [40 * MS])
    monkeypatch.setattr(RecordingWriter, "pending_bytes", 1)
    recorder.sleep_until(80 * MS)
    assert (len(looks), clock_ns) == (1 + 4, [80 * MS])
    monkeypatch.undo()
    recorder.close()


def test_a_thread_that_waits_for_a_processor_is_not_held_by_the_disk() -> None:
    write = disk._Write()
    time.sleep(0.05)
    assert write.held_s() == 0.0, "who asks runs"
    seen: list[float] = []

    def ask() -> None:
        """Until who is asked about, which has just been woken as this began, has come to wait for the end of it."""
        give_up_s = time.monotonic() + 30.0
        while not (seen and seen[-1] > 0.0) and time.monotonic() < give_up_s:
            time.sleep(0.01)
            seen.append(write.held_s())

    asking = threading.Thread(target=ask)
    asking.start()
    asking.join()
    assert seen[-1] > 0.05, "a thread that sleeps is held by whatever it waits for"


_READ = "import sys; open(sys.argv[1], 'rb').read()"


@needs_other_user
@pytest.mark.parametrize("shared", [False, True])
def test_a_recording_is_this_users_alone_unless_it_is_shared(everybodys: Path, shared: bool) -> None:
    """What a trainee did is nobody else's business: another user of the machine is refused."""
    writer = RecordingWriter(everybodys / "a.mcap", {}, shared=shared)
    writer.close()
    assert writer.path.stat().st_mode & 0o777 == (0o644 if shared else 0o600)
    done = as_other_user(_READ, writer.path)
    assert (done.returncode == 0) is shared
    assert ("PermissionError" in done.stderr) is not shared


@needs_other_user
def test_a_link_that_another_user_left_is_not_followed(everybodys: Path, tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    link = "import os, sys; os.symlink(sys.argv[1], sys.argv[2])"
    assert as_other_user(link, tmp_path / "precious", everybodys / "a.mcap").returncode == 0
    with pytest.raises(RecordingError, match="file exists"):
        RecordingWriter(everybodys / "a.mcap", {})
    assert (tmp_path / "precious").read_text() == "mine"


@pytest.mark.parametrize("shared", [False, True])
def test_a_folder_where_others_may_replace_a_recording_is_refused_unless_it_is_shared(
    tmp_path: Path, shared: bool
) -> None:
    folder = tmp_path / "open" / "recordings"
    folder.mkdir(parents=True)
    folder.parent.chmod(0o777)
    if shared:
        RecordingWriter(folder / "a.mcap", {}, shared=True).close()
        return
    with pytest.raises(RecordingError, match=r"others may write to .*open .mode 0777.; recorder.shared: true accepts"):
        RecordingWriter(folder / "a.mcap", {})
