"""The sample recordings: small, valid, a success and a failure, moving; and cut anywhere they are read up to there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.data_stream import ReadDataStream
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from trocar.services.cli.rerun import compare
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.inputs import read_inputs
from trocar.services.recordings.provenance import machine, mechanics_digest
from trocar.services.recordings.reader import read_frames, read_messages

FOLDER = Path(__file__).parents[2] / "docs" / "examples" / "recordings"
TICKS = 4000  # of what is run again here; `trocar replay FILE --check` runs all of it
NAMES = ("insertion-success", "insertion-miss")


@pytest.mark.parametrize("name", NAMES)
def test_they_are_small_and_valid_and_their_scene_moves(name: str) -> None:
    path = FOLDER / f"{name}.mcap"
    assert path.stat().st_size < 1_500_000
    with path.open("rb") as file:
        records = list(StreamReader(file, validate_crcs=True).records)
        file.seek(0)
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        tips = []
        for _schema, _channel, message in reader.iter_messages("/scene"):
            (catheter,) = (each for each in SceneUpdate.FromString(message.data).entities if each.id == "catheter")
            tip = catheter.lines[0].points[-1]
            tips.append((tip.x, tip.y, tip.z))
    assert records
    assert summary is not None
    assert {"scene.yaml", "rig.yaml", "duct.npz"} <= {each.name for each in summary.attachment_indexes}
    assert np.ptp(tips, axis=0).max() > 5e-3


def test_one_inserts_the_catheter_and_the_other_does_not() -> None:
    depth_m = {}
    for name in NAMES:
        states = [body for _, _, body in read_messages(FOLDER / f"{name}.mcap", ["physics.state"])]
        depth_m[name] = max(state.catheter.inserted_length_m for state in states)
    assert depth_m["insertion-success"] > 0.015
    assert depth_m["insertion-miss"] < 0.001


@pytest.mark.parametrize("name", NAMES)
def test_they_run_again_to_the_bit_or_are_refused_with_the_reason(name: str) -> None:
    """Other mechanics made them after a change: `python -m benchmarks.make_samples` makes them anew."""
    inputs = read_inputs(FOLDER / f"{name}.mcap")
    if inputs.metadata["mechanics"] != mechanics_digest():
        with pytest.raises(RecordingError, match="was made by another version of the mechanics"):
            inputs.check_mechanics()
        return
    inputs.check_mechanics()
    del inputs.intakes[TICKS:]
    found = compare(inputs)
    assert found.compared > 5
    if inputs.metadata["machine"] == machine() and not found.has_other_modes:
        assert found.first_difference == ""
    assert found.apart_m < 1e-3


def test_cut_at_a_hundred_random_bytes_it_is_read_up_to_its_last_whole_chunk(tmp_path: Path) -> None:
    path, torn = FOLDER / "insertion-success.mcap", tmp_path / "torn.mcap"
    whole = path.read_bytes()
    times_ns, ends = [], []
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        (journal,) = (number for number, channel in summary.channels.items() if channel.topic == "/haptics/journal")
        for index in summary.chunk_indexes:
            file.seek(index.chunk_start_offset + 9)
            records = breakup_chunk(Chunk.read(ReadDataStream(file)))
            of_journal = [each.log_time for each in records if isinstance(each, Message) and each.channel_id == journal]
            times_ns += of_journal
            ends.append((index.chunk_start_offset + index.chunk_length, len(times_ns)))
    for size in np.random.default_rng(7).integers(8, len(whole), 100).tolist():
        torn.write_bytes(whole[:size])
        found = [each.time_ns for each in read_frames(torn, ["haptics.journal"])]
        kept = max((count for end, count in ends if end <= size), default=0)
        assert found == times_ns[:kept]
