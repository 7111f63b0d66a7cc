"""The bus between gateway and emulated drives: frames arrive as they were sent, nothing waits, nobody else is on it."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import can
import pytest

from trocar.services.gateway.can import canbus
from trocar.services.gateway.can.local_bus import LocalBus

Ends = tuple[LocalBus, LocalBus]


@pytest.fixture
def ends() -> Iterator[Ends]:
    both = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
    first, second = LocalBus(both[0]), LocalBus(both[1])
    yield first, second
    first.shutdown()
    second.shutdown()


@pytest.mark.parametrize(
    "message",
    [
        can.Message(arbitration_id=0x7FF, data=b"", is_extended_id=False),
        can.Message(arbitration_id=0x7FF, data=b"\x01\x02\x03", is_extended_id=False),
        can.Message(arbitration_id=0x1FFFFFFF, data=bytes(range(8)), is_extended_id=True),
        can.Message(arbitration_id=0x29, is_remote_frame=True, is_extended_id=False),
    ],
    ids=["empty", "short", "extended", "remote"],
)
def test_a_frame_arrives_as_it_was_sent_and_only_at_the_other_end(ends: Ends, message: can.Message) -> None:
    ends[0].send(message)
    (heard,) = canbus.drain(ends[1])
    assert message.equals(heard, timestamp_delta=None, check_direction=False)
    assert list(canbus.drain(ends[0])) == []


def test_frames_come_in_their_order_and_waiting_ends(ends: Ends) -> None:
    for k in range(5):
        ends[0].send(can.Message(arbitration_id=k))
    assert [message.arbitration_id for message in canbus.drain(ends[1])] == [0, 1, 2, 3, 4]
    assert ends[1].recv(0.01) is None


def _send(end: LocalBus, message: can.Message, times: int) -> None:
    for _ in range(times):
        end.send(message)


def test_an_end_that_does_not_read_is_an_error_and_no_wait(ends: Ends) -> None:
    message = can.Message(arbitration_id=1)
    with pytest.raises(can.CanOperationError, match="does not listen"):
        _send(ends[0], message, 10_000)
    assert len(list(canbus.drain(ends[1]))) > 100, "what was sent before is there"


def test_an_end_that_is_gone_is_an_error_and_drained_as_nothing(ends: Ends) -> None:
    ends[0].send(can.Message(arbitration_id=1))
    ends[0].shutdown()
    assert [message.arbitration_id for message in canbus.drain(ends[1])] == [1]
    with pytest.raises(can.CanOperationError, match="gone"):
        ends[1].recv(0.0)
    with pytest.raises(can.CanOperationError, match="does not listen"):
        ends[1].send(can.Message(arbitration_id=1))
