"""Who wants every frame without acting on it costs the fast sockets nothing, whatever it does."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Any

import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from trocar.protocol import bodies
from trocar.services.runtime.bus.frame_batches import SENDS_PER_S, BatchSender, join, lengths_and_frames, split
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import Transport

STATE = "gateway.state"
MS = 1_000_000
COME, GONE = b"\x01", b"\x00"


class Socket:
    """Keeps what it is given to send; says who has come and gone."""

    def __init__(self) -> None:
        self.said: list[bytes] = []
        self.sent: list[list[bytes]] = []
        self.touched = 0

    def getsockopt(self, option: int) -> int:
        assert option == zmq.EVENTS
        self.touched += 1
        return zmq.POLLIN if self.said else 0

    def recv(self, _flags: int) -> bytes:
        return self.said.pop(0)

    def send_multipart(self, parts: tuple[bytes, bytes], _flags: int) -> None:
        self.touched += 1
        self.sent.append(split(*parts))


def made(*said: bytes) -> tuple[BatchSender, Socket]:
    socket = Socket()
    socket.said += said
    sender = BatchSender(socket)  # type: ignore[arg-type]
    sender.look()
    socket.touched = 0
    return sender, socket


def run(sender: BatchSender, seconds: float, *, pauses: bool = True) -> list[bytes]:
    """Add a frame a millisecond; a publisher that has no pauses between its ticks sends nothing there."""
    frames = [b"%d" % tick for tick in range(round(1000 * seconds))]
    for tick, frame in enumerate(frames):
        sender.add(frame, tick * MS)
        if pauses:
            sender.send_if_due(tick * MS + MS // 2)
    return frames


@pytest.mark.parametrize("said", [(), (COME, GONE)], ids=["nobody came", "somebody was there"])
def test_while_nobody_listens_nothing_is_kept_and_the_socket_is_not_touched(said: tuple[bytes, ...]) -> None:
    sender, socket = made(*said)
    run(sender, 0.5)
    assert (socket.touched, sender._frames) == (0, [])


@pytest.mark.parametrize("after", [16, 48])
def test_who_came_before_the_first_look_gets_the_first_frames(after: int) -> None:
    """A recording without them cannot be run again: a tick was lost, and hands had moved by then."""
    sender, socket = made()
    frames = [b"%d" % tick for tick in range(after + 20)]
    for tick, frame in enumerate(frames):
        if tick == after:
            assert socket.sent == []
            socket.said.append(COME)
            sender.look()
        sender.add(frame, tick * MS)
        sender.send_if_due(tick * MS + MS // 2)
    sent = [frame for parts in socket.sent for frame in parts]
    assert sent == frames[: len(sent)]
    assert len(sent) > after


@pytest.mark.parametrize("pauses", [True, False])
@pytest.mark.parametrize("n_readers", [1, 4])
def test_every_frame_goes_in_sixty_sends_a_second_to_however_many(n_readers: int, pauses: bool) -> None:
    sender, socket = made(*[COME] * n_readers)
    frames = run(sender, 2.0, pauses=pauses)
    assert sender.readers == n_readers
    assert len(socket.sent) <= 2 * SENDS_PER_S + 1
    assert socket.touched == len(socket.sent)
    sent = [frame for parts in socket.sent for frame in parts]
    assert sent == frames[: len(sent)]
    assert len(frames) - len(sent) <= 1000 // SENDS_PER_S + 1


def test_a_batch_leaves_between_two_ticks_and_not_with_a_frame() -> None:
    sender, socket = made(COME)
    for tick in range(100):
        before = len(socket.sent)
        sender.add(b"frame", tick * MS)
        assert len(socket.sent) == before, "it waits for the pause"
        sender.send_if_due(tick * MS + MS // 2)
    assert len(socket.sent) >= 5


def test_with_the_last_reader_goes_what_was_kept() -> None:
    sender, socket = made(COME, COME)
    run(sender, 0.1)
    for readers in (1, 0):
        socket.said.append(GONE)
        sender.look()
        assert sender.readers == readers
        assert bool(sender._frames) == bool(readers)


def test_a_publisher_that_floods_keeps_a_bounded_number() -> None:
    sender, socket = made(COME)
    for _ in range(5000):
        sender.add(b"frame", 0)
    assert len(sender._frames) == 1000
    sender.send_if_due(20 * MS)
    assert [len(parts) for parts in socket.sent] == [1000]


@pytest.mark.parametrize("frames", [[b"one"], [b"one", b""], [b"a" * 70000, b"b", b"c" * 300]])
def test_a_batch_comes_apart_as_it_was_joined(frames: list[bytes]) -> None:
    assert split(*lengths_and_frames(list(join(frames)))) == frames


@pytest.mark.parametrize(
    "parts",
    [
        [],
        [b""],
        [b"\x01\0\0\0"],
        [b"", b"x"],
        [b"\x01\0\0", b"x"],
        [b"\x02\0\0\0", b"x"],
        [b"\xff" * 8, b"x"],
        [b"\0\0\0\0" * 1001, b""],
        [b"\x01\0\0\0", b"x", b"y"],
    ],
)
def test_what_is_no_batch_stays_as_it_came(parts: list[bytes]) -> None:
    """Its reader refuses it, and counts that."""
    assert split(*lengths_and_frames(list(parts))) == parts


def looked(sender: ZmqBus, reader: ZmqBus) -> tuple[int, int]:
    """Return how many read the fast socket and the batches, when both ends have looked."""
    reader.latest(STATE)
    sender.has_reader(STATE)
    return sender._direct_senders[STATE].readers, sender._batches[STATE].readers


def test_observers_of_every_frame_do_not_subscribe_to_the_fast_socket(
    transport: Transport, eventually: Callable[[Callable[[], bool]], None]
) -> None:
    """Four that read all and never take what they get: the fast socket has one subscriber, who acts on it."""
    sender, reader = ZmqBus(transport, publishes=[STATE]), ZmqBus(transport, reads=[STATE])
    observers = [ZmqBus(transport, reads_every=[STATE]) for _ in range(4)]
    try:
        eventually(lambda: looked(sender, reader) == (1, 4))
        for tick in range(3000):
            sender.publish(STATE, bodies.GatewayState(tick=tick))
        assert looked(sender, reader) == (1, 4)
        observers.pop().close()
        eventually(lambda: sender.has_reader(STATE) and sender._batches[STATE].readers == 3)
    finally:
        for each in (sender, reader, *observers):
            each.close()


class CountedSocket:
    """A socket whose sends are counted."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self.sends = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._socket, name)

    def send_multipart(self, parts: list[bytes], flags: int) -> Any:
        self.sends += 1
        return self._socket.send_multipart(parts, flags)


def _sends(transport: Transport, n_observers: int, eventually: Callable[[Callable[[], bool]], None]) -> tuple[int, int]:
    """Return the sends of 600 ticks at the fast socket and at that of batches."""
    now_ns = 0
    sender, reader = ZmqBus(transport, publishes=[STATE]), ZmqBus(transport, reads=[STATE])
    every = [ZmqBus(transport, reads_every=[STATE]) for _ in range(n_observers)]
    looking = [ZmqBus(transport, samples=[STATE]) for _ in range(n_observers)]
    try:
        eventually(lambda: looked(sender, reader) == (1, n_observers))
        batched = CountedSocket(sender._batches[STATE]._socket)
        sender._batches[STATE]._socket = batched  # type: ignore[assignment]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("trocar.services.runtime.bus.zmq_bus.time.monotonic_ns", lambda: now_ns)
            for tick in range(600):
                now_ns += MS
                sender.publish(STATE, bodies.GatewayState(tick=tick))
                sender.flush()
                assert reader._direct_readers[STATE].newest() is not None, "the fast reader has each frame at once"
        return sender._direct_senders[STATE].sends, batched.sends
    finally:
        for each in (sender, reader, *every, *looking):
            each.close()


def test_more_observers_change_nothing_that_a_millisecond_waits_for(
    transport: Transport, eventually: Callable[[Callable[[], bool]], None]
) -> None:
    """One send a tick to one subscriber, whoever looks on; and at most sixty batches a second, for one or for many."""
    fast, batched = zip(*(_sends(transport, n, eventually) for n in (0, 1, 4)), strict=True)
    assert fast == (600, 600, 600)
    assert batched[0] == 0
    assert 1 <= batched[1] == batched[2] <= round(0.6 * SENDS_PER_S) + 1


def test_the_last_frames_of_a_process_that_ends_arrive(
    transport: Transport, eventually: Callable[[Callable[[], bool]], None]
) -> None:
    sender, observer = ZmqBus(transport, publishes=[STATE]), ZmqBus(transport, reads_every=[STATE])
    heard: list[int] = []
    try:
        eventually(lambda: sender.has_reader(STATE))
        for tick in range(8):
            sender.publish(STATE, bodies.GatewayState(tick=tick))
        sender.close()
        eventually(lambda: heard.extend(frame.body.tick for frame in observer.drain(STATE)) or len(heard) == 8)
        assert heard == list(range(8))
    finally:
        observer.close()


@given(st.lists(st.binary(max_size=60), min_size=1, max_size=20))
def test_frames_of_a_batch_come_out_as_they_went_in(frames: list[bytes]) -> None:
    assert split(*join(frames)) == frames
    assert lengths_and_frames(list(join(frames))) == join(frames)


@given(st.lists(st.binary(max_size=60), max_size=4))
def test_whatever_parts_a_peer_sends_their_lengths_are_those_of_the_frames(parts: list[bytes]) -> None:
    lengths, data = lengths_and_frames(parts)
    assert sum(map(len, split(lengths, data))) == sum(array("I", lengths)) == len(data)
