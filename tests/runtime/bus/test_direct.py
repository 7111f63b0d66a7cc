"""The ends without a thread speak ZeroMQ: with each other, with libzmq on the other side, and whatever a peer says."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zmq

from tests.patience import PATIENCE_S
from trocar.services.runtime.bus import zmtp
from trocar.services.runtime.bus.direct import MAX_PEERS, DirectReader, DirectSender

Eventually = Callable[[Callable[[], bool]], None]
LENGTHS = (0, 1, 255, 256, 5470, 100_000, 1 << 20)


@pytest.fixture
def path(tmp_path: Path) -> str:
    return str(tmp_path / "socket")


@pytest.fixture
def context() -> Iterator[zmq.Context[zmq.Socket[bytes]]]:
    context = zmq.Context()
    yield context
    context.destroy(linger=0)


def body(length: int) -> bytes:
    return bytes(i % 251 for i in range(length))


def pair(path: str) -> tuple[DirectSender, DirectReader]:
    sender, reader = DirectSender(path), DirectReader(path)
    meet(sender, reader)
    assert sender.readers == 1
    return sender, reader


def meet(sender: DirectSender, reader: DirectReader) -> None:
    """Let the ends say their greetings, their READY, and the subscription."""
    for _ in range(3):
        sender.look()
        assert reader.newest() is None
    sender.look()


@pytest.mark.parametrize("length", LENGTHS)
def test_frames_of_every_length_arrive_whole(path: str, length: int) -> None:
    sender, reader = pair(path)
    sender.send(body(length))
    while (frame := reader.newest()) is None:
        assert sender._subscribed[0]._rest
        sender._subscribed[0]._send_rest()
    assert frame == body(length)
    reader.close()
    sender.close()


def test_of_many_the_newest_is_read_once(path: str) -> None:
    sender, reader = pair(path)
    for i in range(20):
        sender.send(b"%d" % i)
    assert reader.newest() == b"19"
    assert reader.newest() is None
    reader.close()
    sender.close()


@pytest.mark.parametrize("length", LENGTHS)
def test_a_subscriber_of_libzmq_reads_what_is_sent(
    path: str, context: zmq.Context[zmq.Socket[bytes]], eventually: Eventually, length: int
) -> None:
    sender, reader = DirectSender(path), context.socket(zmq.SUB)
    reader.connect(f"ipc://{path}")
    sender.look()
    assert sender.readers == 0, "connected is not subscribed"
    reader.setsockopt(zmq.SUBSCRIBE, b"")
    eventually(lambda: (sender.look(), sender.readers == 1)[1])
    sender.send(body(length))
    for expected in (body(length), b"end"):  # what follows takes the rest of a long one with it, once there is room
        eventually(lambda: (sender.send(b"end"), bool(reader.poll(1)))[1])
        assert reader.recv() == expected
    reader.setsockopt(zmq.UNSUBSCRIBE, b"")
    eventually(lambda: (sender.look(), sender.readers == 0)[1])
    reader.close()
    sender.close()


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("kind", [zmq.PUB, zmq.XPUB])
def test_a_publisher_of_libzmq_is_read(
    path: str, context: zmq.Context[zmq.Socket[bytes]], eventually: Eventually, kind: int, length: int
) -> None:
    publisher = context.socket(kind)
    reader = DirectReader(path)  # before there is anybody
    publisher.bind(f"ipc://{path}")
    found: list[bytes] = []

    def arrives() -> bool:
        publisher.send(body(length))
        if reader.wait(time.monotonic_ns() + 5_000_000):
            found.append(reader.newest() or b"")
        return bool(found)

    eventually(arrives)
    assert found[0] == body(length)
    assert reader.violations == 0
    publisher.close()
    reader.close()


def test_a_reader_finds_the_next_publisher_and_keeps_what_the_last_one_said(path: str) -> None:
    sender, reader = pair(path)
    sender.send(b"last words")
    sender.close()
    assert reader.newest() == b"last words"
    assert reader.newest() is None
    other = DirectSender(path)
    until = time.monotonic() + PATIENCE_S
    while not other.readers:
        assert time.monotonic() < until
        assert not reader.wait(time.monotonic_ns() + 1_000_000)
        other.look()
    other.send(b"hello")
    assert reader.wait(time.monotonic_ns() + 10**9)
    assert reader.newest() == b"hello"
    reader.close()
    other.close()


def test_who_does_not_read_loses_frames_and_what_comes_is_whole(path: str) -> None:
    sender, reader = pair(path)
    sent = [body(5000) + b"%d" % i for i in range(500)]
    for data in sent:
        sender.send(data)
    messages = reader._incoming.messages(reader._connection.recv_into(reader._incoming.room))  # type: ignore[union-attr]
    assert messages == sent[: len(messages)]
    assert 0 < len(messages) < 100
    sender.send(b"the next")
    assert reader.newest() == b"the next"
    reader.close()
    sender.close()


def test_a_slow_reader_delays_nobody(path: str) -> None:
    sender, slow = pair(path)
    quick = DirectReader(path)
    meet(sender, quick)
    for i in range(500):
        sender.send(body(5000) + b"%d" % i)
        assert quick.newest() == body(5000) + b"%d" % i
    for each in (slow, quick, sender):
        each.close()


NOT_ZMTP = {
    "nothing of it": b"GET / HTTP/1.1\r\n\r\n".ljust(64),
    "an older version": zmtp.GREETING[:10] + b"\x01" + zmtp.GREETING[11:],
    "keys": zmtp.GREETING.replace(b"NULL\0", b"CURVE"),
    "more parts": zmtp.GREETING + b"\x01\x01a",
    "a part without end": zmtp.GREETING + b"\x02" + b"\xff" * 8,
}


@pytest.mark.parametrize("said", NOT_ZMTP.values(), ids=NOT_ZMTP.keys())
def test_a_subscriber_that_says_something_else_is_dropped(path: str, said: bytes) -> None:
    sender, reader = pair(path)
    stranger = socket.socket(socket.AF_UNIX)
    stranger.connect(path)
    stranger.send(said)
    for _ in range(3):
        sender.look()
    assert len(sender._peers) == 1
    stranger.settimeout(1.0)
    while stranger.recv(1000):
        pass
    sender.send(b"goes on")
    assert reader.newest() == b"goes on"
    for each in (stranger, reader, sender):
        each.close()


@pytest.mark.parametrize("said", NOT_ZMTP.values(), ids=NOT_ZMTP.keys())
def test_a_publisher_that_says_something_else_is_left_and_counted(path: str, said: bytes) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(path)
        listener.listen()
        reader = DirectReader(path)
        stranger = listener.accept()[0]
        stranger.send(said)
        assert reader.newest() is None
        assert reader.violations == 1
        assert not reader.wait(time.monotonic_ns() + 5_000_000)
        stranger.close()
        reader.close()


def test_more_than_so_many_connections_are_refused_and_one_that_goes_makes_room(path: str) -> None:
    sender = DirectSender(path)
    strangers = []
    for _ in range(MAX_PEERS + 5):
        stranger = socket.socket(socket.AF_UNIX)
        stranger.connect(path)
        strangers.append(stranger)
        sender.look()
    assert len(sender._peers) == MAX_PEERS
    for stranger in strangers:
        stranger.close()
    for _ in range(3):
        sender.look()
    assert not sender._peers
    sender.close()


def test_waiting_ends_at_its_time_whether_there_is_a_publisher_or_not(path: str) -> None:
    for sender in (None, DirectSender(path)):
        reader = DirectReader(path)
        until = time.monotonic_ns() + 3_000_000
        assert not reader.wait(until)
        assert until <= time.monotonic_ns()
        reader.close()
        if sender is not None:
            sender.close()


def test_a_publisher_that_was_replaced_does_not_remove_the_socket_of_the_next(path: str) -> None:
    first = DirectSender(path)
    second = DirectSender(path)
    first.close()
    assert Path(path).exists()
    second.close()
    assert not Path(path).exists()


def test_a_frame_in_pieces_is_put_together(path: str) -> None:
    incoming = zmtp.Incoming(0, 1 << 20)
    said = zmtp.GREETING + zmtp.ready(b"PUB") + b"".join(zmtp.framed(body(n)) for n in LENGTHS[:5])
    found: list[bytes] = []
    for i in range(0, len(said), 7):
        piece = said[i : i + 7]
        incoming.room[: len(piece)] = piece
        found += incoming.messages(len(piece))
    assert found == [body(n) for n in LENGTHS[:5]]
