"""The rate that `trocar diagnose sniff` prints is the topic's, however few of its frames are read."""

from __future__ import annotations

import pytest

from trocar import protocol
from trocar.protocol import Frame, bodies
from trocar.services.cli.diagnose.sniff import TopicTally

MS = 1_000_000


def _frame(sequence: int, incarnation: int = 1, start_ns: int = 0) -> bytes:
    body = bodies.GatewayState(tick=sequence)
    return protocol.encode(Frame(1, "gateway.state", 1, incarnation, sequence, start_ns + sequence * MS, 0, True, body))


def test_a_reader_that_gets_one_frame_in_nineteen_sees_the_rate_of_all() -> None:
    tally = TopicTally()
    for sequence in range(0, 1901, 19):
        tally.add(_frame(sequence))
    row = tally.row("gateway.state")
    assert row["rate_hz"] == pytest.approx(1000.0)
    assert (row["frames"], row["gaps"]) == (101, 1800)
    assert row["period_ms_max"] == pytest.approx(19.0)


def test_a_publisher_that_starts_anew_counts_from_its_own_first_frame() -> None:
    tally = TopicTally()
    for sequence in range(100):
        tally.add(_frame(sequence))
    for sequence in range(50):
        tally.add(_frame(sequence, incarnation=2, start_ns=5000 * MS))
    row = tally.row("gateway.state")
    assert (row["rate_hz"], row["gaps"]) == (pytest.approx(1000.0), 0)


def test_one_frame_has_no_rate() -> None:
    tally = TopicTally()
    tally.add(_frame(7))
    tally.add(b"no frame")
    assert (tally.row("gateway.state")["rate_hz"], tally.frames) == (None, 2)
