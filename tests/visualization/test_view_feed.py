"""A client of the view gets the newest picture, whatever its speed, and what it paints is measured."""

import asyncio
import functools
import time
from collections.abc import Awaitable, Callable

import pytest

import trocar.services.visualization.feed as feed_module
from trocar.services.runtime.config.rig import SupervisorSettings
from trocar.services.runtime.measures.histogram import LatencyHistogram
from trocar.services.runtime.process.health import LatencyPath
from trocar.services.visualization import server
from trocar.services.visualization.__main__ import composing_hz
from trocar.services.visualization.feed import IN_FLIGHT, Feed, FeedMessage, Feeds


def on_a_loop(test: Callable[[], Awaitable[None]]) -> Callable[[], None]:
    """Run an asynchronous test."""

    @functools.wraps(test)
    def run() -> None:
        asyncio.run(test())

    return run


def message(sequence: int, epoch: int = 1, origin_ns: int = 0) -> FeedMessage:
    return FeedMessage(epoch, f"hello {epoch}", sequence, origin_ns, f"frame {sequence}".encode())


def a_path() -> LatencyPath:
    return LatencyPath(LatencyHistogram(33_000_000))


async def taken(feed: Feed) -> list[str | bytes] | None:
    """Return what the client may be sent now, None if nothing."""
    try:
        return await asyncio.wait_for(feed.next(), 0.02)
    except TimeoutError:
        return None


@on_a_loop
async def test_only_the_newest_of_many_frames_is_sent():
    feed = Feed(a_path())
    for sequence in range(1000):
        feed.offer(message(sequence))
    assert await taken(feed) == ["hello 1", b"frame 999"]
    assert feed.superseded == 999
    assert await taken(feed) is None


@on_a_loop
async def test_a_client_that_paints_nothing_is_sent_no_more_and_wakes_to_the_newest():
    feed = Feed(a_path())
    sent = []
    for sequence in range(100):
        feed.offer(message(sequence))
        parts = await taken(feed)
        sent += [part for part in parts or [] if isinstance(part, bytes)]
        if len(sent) == IN_FLIGHT:
            break
    for sequence in range(100, 200):
        feed.offer(message(sequence))
    assert await taken(feed) is None
    feed.acknowledge(IN_FLIGHT - 1)
    assert await taken(feed) == [b"frame 199"]


@on_a_loop
async def test_the_hello_comes_again_with_a_new_layout():
    feed = Feed(a_path())
    feed.offer(message(1))
    await feed.next()
    feed.offer(message(2))
    assert await feed.next() == [b"frame 2"]
    feed.offer(message(3, epoch=2))
    assert await feed.next() == ["hello 2", b"frame 3"]


@on_a_loop
async def test_the_painted_picture_is_measured_from_its_device_sample():
    path = a_path()
    feed = Feed(path)
    age_ns = 5_000_000
    feed.offer(message(1, origin_ns=time.monotonic_ns() - age_ns))
    await feed.next()
    feed.acknowledge(1)
    assert (path.asked, path.answered, path.latency.total) == (1, 1, 1)
    assert path.latency.max_ns >= age_ns


@on_a_loop
async def test_an_echo_of_something_never_sent_changes_nothing():
    path = a_path()
    feed = Feed(path)
    feed.offer(message(1, origin_ns=1))
    await feed.next()
    for sequence in (0, 2, 2**64 - 1):
        feed.acknowledge(sequence)
    assert (path.answered, path.latency.total, len(feed.origins)) == (0, 0, 1)


@on_a_loop
async def test_an_echo_twice_counts_once():
    path = a_path()
    feed = Feed(path)
    feed.offer(message(1, origin_ns=1))
    await feed.next()
    feed.acknowledge(1)
    feed.acknowledge(1)
    assert path.latency.total == 1


@on_a_loop
async def test_a_new_client_is_told_the_state_of_the_rig_at_once_and_only_changes_after():
    feeds = Feeds(a_path())
    feeds.tell("running")
    feed = feeds.add()
    assert await taken(feed) == ["running"]
    feeds.tell("running")
    assert await taken(feed) is None
    feeds.tell("degraded")
    assert await taken(feed) == ["degraded"]


@on_a_loop
async def test_a_client_gets_as_many_pictures_as_it_wants_whatever_is_made():
    for made_hz, wanted_hz, got_hz in ((200, 20, 20), (200, 150, 150), (50, 100, 50), (200, None, 200), (36, 15, 15)):
        feed, sent = Feed(a_path()), 0
        await taken(feed)
        feed.epoch = 1
        feed.want(wanted_hz)
        clock = Clock()
        with clock:
            for sequence in range(made_hz):  # a second
                clock.now_ns += round(1e9 / made_hz)
                feed.offer(message(sequence))
                parts = feed._take_parts()
                sent += len(parts)
                if parts:
                    feed.acknowledge(sequence)
        assert abs(sent - got_hz) <= 1, (made_hz, wanted_hz, sent)


class Clock:
    """The feed's clock, which moves when it is told to."""

    now_ns = 10**12

    def __enter__(self):
        self.patch = pytest.MonkeyPatch()
        self.patch.setattr(feed_module.time, "monotonic_ns", lambda: self.now_ns)
        return self

    def __exit__(self, *_):
        self.patch.undo()


@on_a_loop
async def test_a_new_layout_is_sent_at_once_whatever_is_wanted():
    feed = Feed(a_path())
    feed.epoch = 1
    feed.want(1.0)
    with Clock():
        feed.offer(message(1))
        assert await taken(feed) == [b"frame 1"]
        feed.offer(message(2))
        assert await taken(feed) is None
        feed.offer(message(3, epoch=2))
        assert await taken(feed) == ["hello 2", b"frame 3"]


def test_the_fastest_client_says_how_many_are_made():
    feeds = Feeds(a_path())
    assert feeds.wanted_hz() is None
    slow, fast = feeds.add(), feeds.add()
    slow.want(10.0)
    assert feeds.wanted_hz() is None  # one that says nothing takes all
    fast.want(20.0)
    assert feeds.wanted_hz() == 20.0
    feeds.remove(fast)
    assert feeds.wanted_hz() == 10.0
    slow.want(None)
    assert feeds.wanted_hz() is None


def test_a_client_that_takes_one_picture_a_second_does_not_silence_the_process() -> None:
    """Reports are made between pictures: the process was killed as hung, again and again."""
    assert [composing_hz(hz, 30.0) for hz in (None, 60.0, 15.0)] == [30.0, 30.0, 15.0]
    assert 2.0 / composing_hz(server.MIN_HZ, 30.0) < SupervisorSettings().heartbeat_timeout_s
