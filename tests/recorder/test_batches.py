"""What is written a batch at a time is what is written a frame at a time; what is out of the ordinary is looked at."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from protocol import TOPICS, Frame, FrameError, decode, encode
from protocol.arrays import Array
from protocol.fields import Form, fields
from services.recorder.batches import Transcoder, swiftly
from services.recorder.recording import RecordingWriter
from services.recorder.transcode import to_protobuf
from services.runtime import bus
from services.runtime.whole import has_whole_socket, join
from tests.protocol import samples, strategies
from tests.recorder.made_up import MS, state
from tests.recorder.test_recording import message_class

FAST = [name for name, row in TOPICS.items() if has_whole_socket(row)]
HEAD = 31  # bytes of a message record before what it holds


def batch(name: str, frames: list[bytes]) -> bus.Batch:
    return bus.Batch(*join(frames), bus.Inbox(TOPICS[name], every=True))


def parsed(name: str, data: bytes) -> bytes:
    """Return what protobuf makes of a message, in the order of its fields."""
    message = message_class(TOPICS[name].body)()
    message.ParseFromString(data)
    return bytes(message.SerializeToString(deterministic=True))


@pytest.fixture(params=FAST)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_every_fast_topic_can_be_written_by_the_batch(name: str) -> None:
    found = Transcoder(TOPICS[name], 1, 0).records(batch(name, [encode(samples.frame(name))]))
    assert found is not None
    assert parsed(name, found[0].data[HEAD:]) == parsed(name, to_protobuf(samples.frame(name)))


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_any_body_is_written_as_it_would_be_alone(name: str, data: st.DataObject) -> None:
    """Whoever has letters of two bytes, or numbers at a limit, may be left to those who look at each frame."""
    body = data.draw(strategies.bodies(TOPICS[name].body))
    numbers = data.draw(st.tuples(*[st.integers(0, (1 << 62) - 1)] * 4))
    frame = Frame(1, name, TOPICS[name].version, *numbers, data.draw(st.booleans()), body)
    found = Transcoder(TOPICS[name], 1, 0).records(batch(name, [encode(frame)]))
    if found is None:
        assert not _is_plain(body)
    else:
        assert parsed(name, found[0].data[HEAD:]) == parsed(name, to_protobuf(frame))


def _is_plain(body: msgspec.Struct) -> bool:
    """Return whether a body has nothing that is looked at frame by frame, however right it is."""
    for field in fields(type(body)):
        value = getattr(body, field.name)
        inner = [value] if field.form is Form.ONE else value if field.form is Form.MANY else []
        if field.body is not None and not all(map(_is_plain, inner)):
            return False
        if isinstance(value, str) and not value.isascii():
            return False
        if isinstance(value, Array) and value.dtype == "|i1" and not value.data.isascii():
            return False
        if field.item is float and field.limits and str(value) == "-0.0":
            return False
    return True


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_taken_that_the_bus_refuses(name: str, seed: int) -> None:
    """Bytes of good frames changed here and there: what is written is what a look at the frame would have written."""
    chance, whole, taken = random.Random(seed), encode(samples.frame(name)), 0
    transcoder = Transcoder(TOPICS[name], 1, 0)
    for _ in range(3000):
        data = bytearray(whole)
        for _ in range(chance.randrange(1, 4)):
            data[chance.randrange(len(data))] = chance.choice(
                (chance.randrange(256), data[chance.randrange(len(data))])
            )
        if chance.random() < 0.1:
            del data[chance.randrange(len(data)) :]
        found = transcoder.records(batch(name, [bytes(data)]))
        if found is None:
            continue
        taken += 1
        try:
            frame = decode(bytes(data), name, used=False)
        except FrameError as error:
            pytest.fail(f"{error}: {bytes(data)!r}")
        assert parsed(name, found[0].data[HEAD:]) == parsed(name, to_protobuf(frame))
    assert taken > 300, "most changes are to numbers"


def _recorded(path: Path, ways: Any, batches: list[bus.Batch]) -> tuple[list[tuple[Any, ...]], int]:
    writer = RecordingWriter(path, {}, swiftly=ways)
    writer._to_wall_ns = 10**18
    for each in batches:
        writer.take("gateway.state", each)
    writer.close()
    with path.open("rb") as file:
        found = [
            (m.channel_id, m.log_time, m.publish_time, m.sequence, parsed("gateway.state", m.data))
            for _schema, _channel, m in make_reader(file).iter_messages()
        ]
    return found, writer.frames


def _frames(first: int, last: int, **changes: Any) -> list[bytes]:
    return [encode(msgspec.structs.replace(state(n), origin_ns=n * MS // 2, **changes)) for n in range(first, last)]


def _batches() -> list[bus.Batch]:
    """A gap, a frame that is none, another start of the publisher and one that comes back from the first."""
    inbox = bus.Inbox(TOPICS["gateway.state"], every=True)
    parts = [
        _frames(0, 20), _frames(20, 40), _frames(43, 60), [*_frames(60, 70), b"none"], _frames(70, 80),
        _frames(0, 20, incarnation=5), _frames(80, 90), _frames(20, 40, incarnation=5),
        _frames(39, 45, incarnation=5), _frames(45, 60, incarnation=5),
    ]  # fmt: skip
    return [bus.Batch(*join(frames), inbox) for frames in parts]


def test_a_recording_by_the_batch_is_the_one_by_the_frame(tmp_path: Path) -> None:
    """Times, numbers, indexes and counts are the same, whatever came; only who wrote it is another."""
    singly, together = _batches(), _batches()
    expected = _recorded(tmp_path / "singly.mcap", None, singly)
    assert _recorded(tmp_path / "together.mcap", swiftly, together) == expected
    assert expected[1] == 137
    one, other = singly[0].inbox.report(), together[0].inbox.report()
    assert (one.received, one.dropped, one.refused) == (other.received, other.dropped, other.refused)
    assert other.dropped == 3
    assert set(other.refused) == {"malformed", "old_incarnation", "out_of_order"}


def test_a_flood_is_refused_by_the_batch_as_by_the_frame() -> None:
    inbox = bus.Inbox(TOPICS["gateway.state"], every=True)
    first = inbox.accept_all(_frames(0, 1))[0]
    inbox._tokens = 10.0
    run = bus.Run(first.incarnation, 1, 5000, first.sent_ns, 0, True)
    assert not inbox.follow(run)
    assert inbox.received == 1
    assert inbox.follow(bus.Run(first.incarnation, 1, 5, first.sent_ns, 0, True))
    assert (inbox.received, inbox.dropped) == (6, 0)


def test_a_body_with_what_the_kernel_does_not_know_is_left_to_the_others() -> None:
    assert swiftly(TOPICS["physics.health"], 1, 0) is None
