"""Recordings hold what was sent, in a form that others read, and survive a crash up to the last chunk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from google.protobuf import descriptor_pool, message_factory
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from tests.by_day import examples
from tests.protocol import samples, strategies
from tests.recorder.made_up import long_recording, settle
from trocar.protocol import TOPICS, bodies, former
from trocar.protocol.arrays import Array, Spec, pack
from trocar.protocol.fields import arrays, fields
from trocar.protocol.table import columns
from trocar.services.recorder.recording import RecordingWriter
from trocar.services.recordings import foreign
from trocar.services.recordings.reader import read_frames, read_messages, read_moments
from trocar.services.recordings.schema import PACKAGE, file_descriptor
from trocar.services.recordings.transcode import to_frame, to_protobuf


@pytest.mark.parametrize("name", TOPICS)
def test_every_topic_comes_back(tmp_path: Path, name: str) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", {"rig": "test"})
    frame = samples.frame(name)
    writer.write(frame)
    writer.close()
    (read,) = read_frames(writer.path)
    assert read.frame == frame


def test_contacts_of_version_4_are_read_without_their_pairs() -> None:
    """So were they recorded: their tools are named rows, which the bytes of the bus are not."""
    now = samples.frame("haptics.contacts")
    body = former.ToolContacts4(
        tick=now.body.tick,
        tools=now.body.tools,
        pair_index=pack([[0, 1, 0, 17]], "<i4"),
        pair_geometry=pack([[0.25, 0.2, 0.3, 0.5, 0.0, 0.0, 1.0, -1e-4]]),
        holds=now.body.holds,
        begins=3,
    )
    read = to_frame(now.topic, to_protobuf(msgspec.structs.replace(now, version=4, body=body)))
    assert read == msgspec.structs.replace(now, body=msgspec.structs.replace(now.body, begins=3))


def test_others_read_numbers_arrays_and_named_rows_without_this_project(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", {})
    for name in ("gateway.state", "physics.state", "haptics.contacts", "physics.health"):
        writer.write(samples.frame(name))
    writer.close()
    with writer.path.open("rb") as file:
        read = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        by_topic = {channel.topic: body for _schema, channel, _message, body in read}
    assert list(by_topic["/gateway/state"].instruments[0].position_m) == [0.1, 0.2, 0.3]
    np.testing.assert_array_equal(by_topic["/physics/state"].duct.q, [1.0, 2.0])
    tool = samples.frame("physics.state").body.reactions()[0]
    (named,) = by_topic["/physics/state"].tools
    assert (tuple(named.force_n), named.grasp_torque_nm) == (tool.force_n, tool.grasp_torque_nm)
    contacts = by_topic["/haptics/contacts"]
    assert [tuple(tool.port_m) for tool in contacts.tools] == [(0.0, 0.0, 0.1)]
    assert [(hold.hold_id, list(hold.target_weights)) for hold in contacts.holds] == [(2, [0.5, 0.5, 0.0])]
    assert by_topic["/physics/health"].topics[0].refused["malformed"] == 1


def message_class(body: type[msgspec.Struct]) -> Any:
    """Return protobuf's class of `body`, in a pool of its own: nested names repeat between bodies."""
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file_descriptor(body).file[0])
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{PACKAGE}.{body.__name__}"))


@pytest.mark.parametrize("name", TOPICS)
def test_the_bytes_are_those_that_protobuf_itself_would_read(name: str) -> None:
    """Every scalar, vector and array of the body, through protobuf's own parser."""
    frame = samples.frame(name)
    message = message_class(type(frame.body))()
    message.ParseFromString(to_protobuf(frame))
    _assert_same(message, frame.body)


def _assert_same(message: Any, body: msgspec.Struct) -> None:
    for field in body.__struct_fields__:
        value, got = getattr(body, field), getattr(message, field)
        if isinstance(value, Array) and spec_of(body, field).row is not None:
            _assert_same_rows(got, value, spec_of(body, field).row)
        elif isinstance(value, Array):
            assert list(got) == value.view().ravel().tolist(), field
        elif isinstance(value, msgspec.Struct):
            _assert_same(got, value)
        elif isinstance(value, tuple) and value and isinstance(value[0], msgspec.Struct):
            for one, other in zip(got, value, strict=True):
                _assert_same(one, other)
        elif isinstance(value, tuple):
            assert tuple(got) == value, field
        elif isinstance(value, dict):
            assert dict(got) == value, field
        elif value is not None:
            assert got == value, field


def spec_of(body: msgspec.Struct, name: str) -> Spec:
    return dict(arrays(type(body)))[name]


def _assert_same_rows(messages: Any, table: Array, row: Any) -> None:
    for message, numbers in zip(messages, table.view().tolist(), strict=True):
        first = dict(zip(row.order(), columns(row), strict=False))
        for field in fields(row):
            assert np.ravel(getattr(message, field.name)).tolist() == numbers[first[field.name] :][: field.count]


def test_negative_and_large_integers_survive() -> None:
    state = bodies.InstrumentState(name="x", position_m=(0.0, 0.0, 0.0), model_sequence=-1, buttons=(1 << 16) - 1)
    body = bodies.GatewayState(tick=(1 << 62) + 5, instruments=(state,))
    message = message_class(bodies.GatewayState)()
    message.ParseFromString(to_protobuf(msgspec.structs.replace(samples.frame("gateway.state"), body=body)))
    _assert_same(message, body)


@settings(max_examples=examples(25, 200), deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
@pytest.mark.parametrize("name", TOPICS)
def test_any_body_comes_back(name: str, data: st.DataObject) -> None:
    frame = msgspec.structs.replace(samples.frame(name), body=data.draw(strategies.bodies(TOPICS[name].body)))
    message = message_class(type(frame.body))()
    message.ParseFromString(to_protobuf(frame))
    _assert_same(message, frame.body)
    assert to_frame(name, to_protobuf(frame)) == frame


def test_unsigned_numbers_of_64_bits_are_their_twos_complement() -> None:
    """The wire's integers may be unsigned: a sender of such a number must not end the recording."""
    frame = msgspec.structs.replace(samples.frame("gateway.state"), incarnation=(1 << 64) - 1, origin_ns=1 << 63)
    message = message_class(bodies.GatewayState)()
    message.ParseFromString(to_protobuf(frame))
    assert (message.envelope.incarnation, message.envelope.origin_ns) == (-1, -(1 << 63))


def test_negative_numbers_of_one_byte_survive() -> None:
    contacts = bodies.ContactForces(kind=pack([0, -1, -128, 127], "|i1"), point_m=pack(np.zeros((4, 3))),
                                    force_n=pack(np.zeros((4, 3))))  # fmt: skip
    frame = samples.frame("physics.state")
    body = msgspec.structs.replace(frame.body, contacts=contacts)
    message = message_class(bodies.PhysicsState)()
    message.ParseFromString(to_protobuf(msgspec.structs.replace(frame, body=body)))
    _assert_same(message, body)


def test_a_crash_loses_at_most_the_last_chunk(tmp_path: Path) -> None:
    """The file as the kernel has it, with no orderly end: all but the last half second is there."""
    writer = long_recording(tmp_path / "a.mcap", 2900)
    settle(writer)
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(writer.path.read_bytes())
    ticks = [each.frame.body.tick for each in read_frames(torn)]
    assert ticks == list(range(2501))
    writer.close()
    assert len(list(read_messages(writer.path))) == 2900


@pytest.mark.parametrize("cut", [1, 100, 5000])
def test_a_file_torn_anywhere_is_read_up_to_there(tmp_path: Path, cut: int) -> None:
    writer = long_recording(tmp_path / "a.mcap", 2000)
    writer.close()
    whole = writer.path.read_bytes()
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(whole[: len(whole) // 2 - cut])
    ticks = [each.frame.body.tick for each in read_frames(torn)]
    assert ticks == list(range(len(ticks)))
    assert len(ticks) > 300


def test_a_moment_is_the_newest_of_each_and_no_more_than_that_is_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    topics, writer = ("gateway.state", "haptics.contacts", "physics.state"), RecordingWriter(tmp_path / "a.mcap", {})
    for tick in range(100):
        for k, name in enumerate(topics if tick % 10 == 3 else topics[:1]):
            frame = samples.frame(name)
            body = msgspec.structs.replace(frame.body, tick=tick)
            writer.write(msgspec.structs.replace(frame, sent_ns=(tick + 1) * 1_000_000 + k, body=body))
    writer.close()
    decoded = []
    monkeypatch.setattr(foreign, "to_frame", lambda name, data: decoded.append(name) or to_frame(name, data))
    moments = list(read_moments(writer.path, topics))
    assert [tuple(body.tick for body in each) for each in moments] == [(tick,) * 3 for tick in range(3, 100, 10)]
    assert len(list(foreign.moments(str(writer.path), topics))) == 2, "the first at once, the others together"
    assert decoded == [*topics] * 10


def test_the_file_says_what_it_is(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.mcap", {"rig": "stub"})
    writer.write(samples.frame("physics.state"))
    writer.close()
    with writer.path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
    assert summary is not None
    assert [schema.encoding for schema in summary.schemas.values()] == ["protobuf"]
    assert metadata["trocar"]["rig"] == "stub"
    assert int(metadata["trocar"]["wall_minus_monotonic_ns"]) > 0
