"""A frame that claims what its publisher never sent deafens no reader: sequences, incarnations and times by chance."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.supervisor.made_up import health
from trocar import protocol
from trocar.protocol import TOPICS, Frame, bodies
from trocar.services.runtime.bus import bus as bus_module
from trocar.services.runtime.bus.bus import GONE_S, Inbox

STATE = "gateway.state"
TRUE, SUCCESSOR = 5, 6
MS = 1_000_000
_BODIES: dict[str, Callable[[], object]] = {
    STATE: lambda: bodies.GatewayState(tick=1),
    "supervisor.state": lambda: bodies.SupervisorState(state="running"),
    "gateway.health": lambda: health("gateway"),
}


class Reader:
    """A reader of one topic, with a clock of its own."""

    def __init__(self, topic: str, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns, self.row, self._body = 10**15, TOPICS[topic], _BODIES[topic]()
        monkeypatch.setattr(bus_module, "time", SimpleNamespace(monotonic_ns=lambda: self.now_ns))
        self.inbox = Inbox(self.row)

    def take(self, incarnation: int, sequence: int, sent_ns: int | None = None) -> bool:
        """Return whether a frame is accepted that was sent now, or when it says."""
        frame = Frame(
            protocol.PROTOCOL_VERSION, self.row.name, self.row.version, incarnation, sequence,
            self.now_ns if sent_ns is None else sent_ns, 0, True, self._body,
        )  # fmt: skip
        return self.inbox.accept(protocol.encode(frame)) is not None

    def run(self, incarnation: int, sequence: int, seconds: float) -> tuple[int, float]:
        """Send from a number on; return the next number, and the time without a frame at the end."""
        silent_s = 0.0
        for _ in range(round(seconds * self.row.rate_hz)):
            self.now_ns += round(1e9 / self.row.rate_hz)
            silent_s = 0.0 if self.take(incarnation, sequence) else silent_s + 1.0 / self.row.rate_hz
            sequence += 1
        return sequence, silent_s


@pytest.fixture
def reader(monkeypatch: pytest.MonkeyPatch) -> Reader:
    return Reader(STATE, monkeypatch)


@pytest.mark.parametrize("sequence", [2**63 - 1, 2**40, 10**9])
def test_a_step_that_no_publisher_can_make_is_refused(reader: Reader, sequence: int) -> None:
    """One frame with the sequence 2^63 - 1 made its reader deaf until the publisher was started again."""
    following, _ = reader.run(TRUE, 1000, 0.1)
    assert not reader.take(TRUE, sequence)
    assert reader.take(TRUE, following)
    assert reader.inbox.superseded == 0


@pytest.mark.parametrize("topic", _BODIES)
@given(
    forged=st.lists(
        st.tuples(
            st.sampled_from([TRUE, TRUE, SUCCESSOR, 2**48 - 1]),
            st.one_of(st.integers(0, 2**63 - 1), st.integers(0, 100_000)),
            st.one_of(st.none(), st.integers(0, 2**63 - 1)),
        ),
        min_size=1, max_size=12,
    ),
    first=st.sampled_from([0, 1, 10**6, 10**12]),
    before_s=st.sampled_from([0.0, 0.3]),
)  # fmt: skip
def test_no_forged_frames_are_believed_for_longer_than_a_silence(
    topic: str, forged: list[tuple[int, int, int | None]], first: int, before_s: float
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        reader = Reader(topic, patch)
        following, _ = reader.run(TRUE, first, before_s)
        for incarnation, sequence, sent_ns in forged:
            reader.take(incarnation, sequence, sent_ns)
        deaf_s = max(GONE_S, reader.row.stale_after_s)
        following, _ = reader.run(TRUE, following, deaf_s + 2.0 / reader.row.rate_hz)
        _, silent_s = reader.run(TRUE, following, 5.0 / reader.row.rate_hz)
        assert silent_s == 0.0
        assert reader.inbox.is_fresh(reader.now_ns)


@given(kept=st.lists(st.integers(1, 40_000), min_size=1, max_size=40), pause_ms=st.integers(0, 60_000))
def test_a_true_publisher_is_believed_however_many_frames_are_lost(kept: list[int], pause_ms: int) -> None:
    """Queues hold some seconds of frames, and what does not fit is lost: numbers step as far as time has gone on."""
    with pytest.MonkeyPatch.context() as patch:
        reader = Reader(STATE, patch)
        sequence = 0
        assert reader.take(TRUE, sequence)
        for step in kept:
            sequence += step
            reader.now_ns += step * MS
            assert reader.take(TRUE, sequence, reader.now_ns - pause_ms * MS)


def test_who_was_replaced_comes_back_only_where_its_successor_is_silent(reader: Reader) -> None:
    following, _ = reader.run(TRUE, 0, 0.1)
    other, _ = reader.run(SUCCESSOR, 0, 0.1)
    for _ in range(2000):  # both speak: a process that was stopped, and goes on
        reader.now_ns += MS
        assert not reader.take(TRUE, following)
        assert reader.take(SUCCESSOR, other)
        following, other = following + 1, other + 1
    reader.now_ns += round(1.1e9 * GONE_S)
    assert not reader.take(TRUE, following, reader.now_ns - 50 * MS), "left over in a queue"
    assert reader.take(TRUE, following)


def test_the_past_of_a_publisher_is_never_believed(reader: Reader) -> None:
    following, _ = reader.run(TRUE, 0, 0.5)
    past_ns = reader.now_ns
    reader.now_ns += 10**9
    for sequence in range(following):
        assert not reader.take(TRUE, sequence, past_ns - (following - sequence) * MS)
