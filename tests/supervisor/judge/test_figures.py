"""Windows are differences of cumulative counts; a restarted process begins anew."""

from __future__ import annotations

import math

import numpy as np
import pytest

import trocar.protocol.bodies as bodies
from tests.supervisor.made_up import MS, health, histogram, loop_report
from trocar.services.runtime.measures.histogram import LatencyHistogram
from trocar.services.supervisor.judge import figures
from trocar.services.supervisor.judge.window import Window
from trocar.services.supervisor.run_counts import Tally


def test_a_window_is_newest_minus_oldest() -> None:
    window = Window(60.0)
    for k in range(31):  # 3 s of reports every 100 ms; 10 % of the ticks of the last second miss
        misses = max(0, k - 20) * 10
        body = health("physics", uptime_s=k / 10, loop=loop_report(100 * k, misses))
        window.add(body.pid, figures.of(body))
    seen = window.figures(1.0)
    assert seen is not None
    assert seen.loop is not None
    assert seen.seconds == pytest.approx(1.0)
    assert (seen.loop.ticks, seen.loop.misses) == (1000, 100)
    assert seen.loop.miss_ratio == pytest.approx(0.1)
    assert seen.loop.lateness.late == 100


def test_a_minute_is_kept_in_few_reports_and_asked_for_in_any_part() -> None:
    window = Window(60.0)
    for k in range(1201):
        window.add(7, figures.of(health("physics", uptime_s=k / 10, loop=loop_report(100 * k))))
    for seconds, off in ((0.2, 0.01), (1.0, 0.01), (5.0, 0.01), (20.0, 1.0), (60.0, 1.0)):
        seen = window.figures(seconds)
        assert seen is not None
        assert seen.loop is not None
        assert 0.0 <= seen.seconds - seconds + 1e-6 <= off
        assert seen.loop.ticks == pytest.approx(1000 * seen.seconds)
    assert len(window) < 130


def test_skipped_ticks_are_due_ticks() -> None:
    """900 ran, 100 never did: 10 % missed, not 11 %."""
    loop = figures.Loop.of(loop_report(900, misses=100, skipped=100))
    assert loop.miss_ratio == pytest.approx(0.1)


def test_nothing_due_is_unknown_not_zero() -> None:
    assert math.isnan(figures.Loop.of(loop_report(0)).miss_ratio)


@pytest.mark.parametrize("first_heard_s", [0.5, 9.0])
def test_a_restart_empties_the_window_and_a_tally_counts_what_both_did(first_heard_s: float) -> None:
    window = Window(5.0)
    tally = Tally(health("physics", uptime_s=0.5, loop=loop_report(500), pid=7))
    for k in range(5):
        body = health("physics", uptime_s=k + 1.0, loop=loop_report(1000 * (k + 1), misses=k), pid=7)
        window.add(body.pid, figures.of(body))
        tally.add(body)
    fresh = health("physics", uptime_s=first_heard_s, loop=loop_report(400), pid=8)
    window.add(fresh.pid, figures.of(fresh))
    tally.add(fresh)
    assert window.figures(5.0) is None
    counted = tally.counts()
    assert counted.loop is not None
    assert counted.loop.ticks == 4500 + 400
    assert counted.seconds == 4.5 + first_heard_s


def test_a_restart_under_the_same_pid_is_seen_by_its_age() -> None:
    """In a container every incarnation is process 1."""
    window = Window(5.0)
    for uptime_s, ticks in ((10.0, 10000), (11.0, 11000), (0.3, 300)):
        window.add(1, figures.of(health("physics", uptime_s=uptime_s, loop=loop_report(ticks), pid=1)))
    assert window.figures(5.0) is None


def test_forgetting_begins_at_the_newest_report() -> None:
    window = Window(5.0)
    for k, misses in enumerate((0, 500, 500, 500)):
        window.add(7, figures.of(health("physics", uptime_s=float(k), loop=loop_report(1000 * (k + 1), misses))))
        if k == 1:
            window.forget()
    seen = window.figures(5.0)
    assert seen is not None
    assert seen.loop is not None
    assert (seen.loop.ticks, seen.loop.misses) == (2000, 0)


def test_coarse_buckets_keep_total_and_deadline() -> None:
    generator = np.random.default_rng(1)
    made = LatencyHistogram(MS)
    for duration in generator.lognormal(np.log(8e5), 1.5, 3000):
        made.record(int(duration))
    fine = figures.Latencies.of(made.body())
    edges_us, counts = fine.coarse()
    assert counts.sum() == fine.total == 3000
    assert len(counts) == len(edges_us) + 1
    assert np.allclose(np.diff(np.log2(edges_us)), 0.5)
    deadline = int(np.flatnonzero(np.isclose(edges_us, 1000.0))[0])
    assert counts[deadline + 1 :].sum() == fine.late
    assert 0 < fine.late < 3000


def test_a_histogram_of_another_size_counts_as_empty() -> None:
    body = histogram([1000])
    other = bodies.Histogram(deadline_ns=MS, counts=figures_array(5), total=5)
    assert figures.Latencies.of(body).total == 1
    assert figures.Latencies.of(other).total == 0


def figures_array(length: int) -> object:
    from trocar.protocol.arrays import pack

    return pack(np.ones(length), "<i8")


def test_a_difference_is_of_every_count() -> None:
    older, newer = (
        health(
            "gateway",
            uptime_s=float(k),
            loop=loop_report(1000 * k, misses=3 * k, skipped=k),
            paths=(bodies.PathLatency(name="servo", latency=histogram([MS] * 10 * k), answered=99 * k, asked=100 * k),),
            topics=(
                bodies.TopicReport(
                    topic="x", sent=5 * k, received=7 * k, superseded=2 * k, dropped=k, age=histogram([MS] * 4 * k)
                ),
            ),
        )
        for k in (1, 3)
    )
    since = figures.of(newer) - figures.of(older)
    assert since.seconds == 2.0
    assert since.loop is not None
    assert (since.loop.ticks, since.loop.misses, since.loop.skipped) == (2000, 6, 2)
    assert [part.total for part in (since.loop.lateness, since.loop.work)] == [2000] * 2
    path, topic = since.paths["servo"], since.topics["x"]
    assert (path.latency.total, path.answered, path.asked) == (20, 198, 200)
    assert (topic.sent, topic.received, topic.superseded, topic.dropped) == (10, 14, 4, 2)
    assert topic.age is not None
    assert topic.age.total == 8


def test_traffic_of_all_readers_adds_up() -> None:
    a = figures.Traffic(received=10, dropped=1, refused={"flood": 2}, age=figures.Latencies.of(histogram([MS])))
    b = figures.Traffic(sent=12, refused={"flood": 1, "body": 3}, age=figures.Latencies.of(histogram([2 * MS])))
    both = a + b
    assert (both.sent, both.received, both.dropped) == (12, 10, 1)
    assert both.refused == {"flood": 3, "body": 3}
    assert both.age is not None
    assert both.age.total == 2
    assert (both - a).refused == {"flood": 1, "body": 3}


def test_another_rate_begins_a_window_anew_and_loses_no_counts() -> None:
    window, tally = Window(60.0), Tally(None)
    for k in range(40):
        loop = loop_report(100 * (k + 1), rate_hz=36.0 if k < 20 else 15.0)
        body = health("visualization", uptime_s=k / 10, loop=loop)
        window.add(7, figures.of(body))
        tally.add(body)
        if k == 20:
            assert window.figures(60.0) is None
    counted = tally.counts()
    assert counted.loop is not None
    assert counted.loop.ticks == 4000
    seen = window.figures(60.0)
    assert seen is not None
    assert seen.loop is not None
    assert (seen.loop.ticks, seen.loop.target_hz) == (1900, 15.0)
