"""Clocks of two hosts: what is estimated holds for certain, and no frame is dated by a clock that nobody knows."""

from __future__ import annotations

import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from trocar import protocol
from trocar.protocol import Frame, bodies, topic
from trocar.services.runtime.bus import bus as bus_module
from trocar.services.runtime.bus.bus import Inbox
from trocar.services.runtime.bus.clocks import DRIFT, ClockOffset

STATE = "gateway.state"
HOUR_NS = 3_600_000_000_000
MS = 1_000_000
NOW_NS = 10**13

#: Of one trip: time since the last, way there, way back, in us.
trips = st.lists(st.tuples(st.integers(1, 10**7), st.integers(0, 10**6), st.integers(0, 10**6)), min_size=1)


@example([(1, 0, 10**6)], 0, DRIFT, 0)  # the way there takes no time, and the clock drifts on the way back
@given(trips, st.integers(-(10**15), 10**15), st.floats(-DRIFT, DRIFT), st.integers(0, 10**6))
def test_the_true_offset_is_never_further_off_than_said(
    trips: list[tuple[int, int, int]], offset_ns: int, drift: float, later_us: int
) -> None:
    """Whatever the ways take, and however unlike they are."""
    clock, now_ns = ClockOffset(), NOW_NS

    def theirs(ns: int) -> int:
        return ns + offset_ns + round(drift * (ns - NOW_NS))

    for apart_us, there_us, back_us in trips:
        asked_ns = now_ns + 1000 * apart_us
        told_ns = theirs(asked_ns + 1000 * there_us)
        now_ns = asked_ns + 1000 * (there_us + back_us)
        clock.take_answer(asked_ns, told_ns, now_ns)
    now_ns += 1000 * later_us
    if theirs(now_ns) > 10**7:  # ours would be before it began
        assert abs(clock.here_ns(theirs(now_ns)) - max(1, now_ns)) <= clock.uncertainty_ns(now_ns) + 2 + len(trips)


def test_a_short_trip_tightens_and_time_widens() -> None:
    clock = ClockOffset()
    clock.take_answer(NOW_NS, NOW_NS + HOUR_NS + 50 * MS, NOW_NS + 100 * MS)
    wide_ns = clock.uncertainty_ns(NOW_NS + 100 * MS)
    clock.take_answer(NOW_NS + 200 * MS, NOW_NS + HOUR_NS + 200 * MS, NOW_NS + 201 * MS)
    tight_ns = clock.uncertainty_ns(NOW_NS + 201 * MS)
    clock.take_answer(
        NOW_NS + 300 * MS, NOW_NS + HOUR_NS + 350 * MS, NOW_NS + 400 * MS
    )  # a long one takes nothing away
    assert wide_ns == pytest.approx(50 * MS, rel=0.01)
    assert tight_ns <= 1.3 * MS < clock.uncertainty_ns(NOW_NS + 1400 * MS) < 3 * MS


def test_a_host_that_has_booted_has_another_clock() -> None:
    clock = ClockOffset()
    clock.take_answer(NOW_NS, NOW_NS + HOUR_NS, NOW_NS + MS)
    clock.take_answer(NOW_NS + 10 * MS, 5 * MS, NOW_NS + 11 * MS)
    assert clock.here_ns(5 * MS) == pytest.approx(NOW_NS + 10.5 * MS, abs=MS)


@pytest.mark.parametrize(
    ("age_ms", "round_trip_ms", "fresh"),
    [(1, 1, True), (4, 1, True), (4, 4, False), (1, 9, False), (6, 1, False), (-3, 1, False), (None, 1, False)],
)
def test_a_frame_of_another_host_is_as_old_as_it_may_be(
    age_ms: float | None, round_trip_ms: float, fresh: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What moves the hand is stale after 5 ms; an age that is not known, or in the future, is too old as well."""
    monkeypatch.setattr(bus_module, "time", SimpleNamespace(monotonic_ns=lambda: NOW_NS))
    clock = ClockOffset()
    if age_ms is not None:
        asked_ns, heard_ns = NOW_NS - round(round_trip_ms * MS), NOW_NS
        clock.take_answer(asked_ns, (asked_ns + heard_ns) // 2 + HOUR_NS, heard_ns)
    inbox = Inbox(topic(STATE))
    inbox.clock = clock
    sent_ns = NOW_NS + HOUR_NS - round((age_ms or 0) * MS)
    frame = inbox.accept(_said(sent_ns, sent_ns - MS))
    assert inbox.is_fresh(NOW_NS) is fresh
    assert frame is not None
    if age_ms is None:
        assert (frame.sent_ns, frame.origin_ns) == (NOW_NS, 0)
        assert inbox.age.total == 0
    elif age_ms > 0:
        assert frame.sent_ns == pytest.approx(NOW_NS - age_ms * MS, abs=10_000)
        assert frame.origin_ns == pytest.approx(frame.sent_ns - MS, abs=10_000)


def test_a_frame_from_the_future_of_this_host_is_of_no_clock_of_ours() -> None:
    """As through a tunnel to another host that looks like this one: it stayed fresh for as long as that was ahead."""
    inbox, now_ns = Inbox(topic(STATE)), time.monotonic_ns()
    inbox.accept(_said(now_ns + HOUR_NS, 0))
    assert not inbox.is_fresh(now_ns)


def _said(sent_ns: int, origin_ns: int) -> bytes:
    version = topic(STATE).version
    body = bodies.GatewayState(tick=1)
    return protocol.encode(Frame(protocol.PROTOCOL_VERSION, STATE, version, 5, 1, sent_ns, origin_ns, True, body))


def test_a_time_namespace_has_a_clock_of_its_own() -> None:
    code = "import trocar.services.runtime.bus.clocks as clocks; print(clocks.OWN_CLOCK.hex())"
    command = [sys.executable, "-c", code]
    ours = [subprocess.run(command, check=True, capture_output=True, text=True).stdout for _ in range(2)]
    apart = subprocess.run(
        ["unshare", "--time", "--monotonic", "60", "--fork", *command], check=False, capture_output=True, text=True
    )
    assert ours[0] == ours[1] != ""
    if apart.returncode != 0:
        pytest.skip(f"no time namespaces here: {apart.stderr}")
    assert apart.stdout not in ("", ours[0])
