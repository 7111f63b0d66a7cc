"""The same behaviour on the bus in memory and on the real one, and what strange peers can and cannot do."""

from __future__ import annotations

import fcntl
import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any, Literal

import msgspec
import pytest
import zmq

from tests.memory_bus import MemoryBus, MemoryHub
from tests.ports import base_port
from trocar import protocol
from trocar.protocol import TOPICS, Frame, bodies
from trocar.services.runtime.bus import bus as bus_module
from trocar.services.runtime.bus import endpoints
from trocar.services.runtime.bus.endpoints import endpoint, lock_holders
from trocar.services.runtime.bus.frame_batches import SENDS_PER_S, batch_endpoint
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import Transport
from trocar.services.runtime.errors import BusError

STATE = "gateway.state"
STALE_S = 60.0
Make = Callable[..., Any]
Eventually = Callable[[Callable[[], bool]], None]


@pytest.fixture(params=["memory", "ipc", "tcp"])
def make(request: pytest.FixtureRequest, transport: Transport) -> Iterator[Make]:
    """Return a maker of buses that meet: ``make(publishes=..., reads=..., reads_every=...)``."""
    hub = MemoryHub()
    tcp = Transport(kind="tcp", base_port=base_port(22_400))
    with ExitStack() as stack:

        def maker(**topics: Iterable[str]) -> Any:
            if request.param == "memory":
                made: Any = MemoryBus(hub, **topics)
            else:
                made = ZmqBus(transport if request.param == "ipc" else tcp, **topics)
            stack.callback(made.close)
            return made

        yield maker


def state(tick: int) -> bodies.GatewayState:
    return bodies.GatewayState(tick=tick)


def connected(sender: Any, eventually: Eventually, reader: Any = None) -> None:
    """Wait until they have met; a reader of a fast topic connects when it looks."""
    eventually(lambda: bool((reader and reader.latest(STATE)) or sender.has_reader(STATE)))


def test_a_reader_of_state_gets_the_newest_frame_once(make: Make, eventually: Eventually) -> None:
    reader, sender = make(reads=[STATE]), make(publishes=[STATE])
    connected(sender, eventually, reader)
    for tick in range(100):
        sender.publish(STATE, state(tick), origin_ns=tick)
    got: list[Frame] = []
    eventually(lambda: bool((frame := reader.latest(STATE)) and (got.append(frame) or frame.body.tick == 99)))
    assert got[-1].origin_ns == 99
    assert reader.latest(STATE) is None


def test_what_a_newer_frame_has_replaced_is_counted() -> None:
    hub = MemoryHub()
    sender, reader = MemoryBus(hub, publishes=[STATE]), MemoryBus(hub, reads=[STATE])
    for sent in (1, 4, 2):
        for _ in range(sent):
            sender.publish(STATE, state(0))
        assert reader.latest(STATE) is not None
    report = reader.reports()[0]
    assert (report.received, report.superseded, report.dropped) == (3, 4, 0)


def test_a_reader_of_every_frame_gets_all_in_order(make: Make, eventually: Eventually) -> None:
    sender, reader = make(publishes=[STATE]), make(reads_every=[STATE])
    connected(sender, eventually)
    ticks: list[int] = []
    for tick in range(90):
        sender.publish(STATE, state(tick))
    time.sleep(1.0 / SENDS_PER_S)
    sender.publish(STATE, state(90))  # with it leaves what was kept

    def drained() -> bool:
        ticks.extend(frame.body.tick for frame in reader.drain(STATE))
        return len(ticks) == 91

    eventually(drained)
    assert ticks == list(range(91))
    assert next(r for r in reader.reports() if r.topic == STATE).dropped == 0


def test_a_late_joiner_gets_what_is_sent_from_then_on(make: Make, eventually: Eventually) -> None:
    sender = make(publishes=[STATE])
    sender.publish(STATE, state(1))
    reader = make(reads=[STATE])
    connected(sender, eventually, reader)
    assert reader.latest(STATE) is None
    sender.publish(STATE, state(2))
    got: list[Frame] = []
    eventually(lambda: bool((frame := reader.latest(STATE)) and not got.append(frame)))
    assert got[0].body.tick == 2


def test_what_the_sender_calls_invalid_or_old_is_not_fresh(
    make: Make, eventually: Eventually, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Long enough that a busy machine does not make a frame old before it is looked at.
    monkeypatch.setitem(TOPICS, STATE, replace(TOPICS[STATE], stale_after_s=STALE_S))
    sender, reader = make(publishes=[STATE]), make(reads=[STATE])
    connected(sender, eventually, reader)
    assert not reader.is_fresh(STATE)
    sender.publish(STATE, state(1), valid=False)
    eventually(lambda: reader.latest(STATE) is not None)
    assert not reader.is_fresh(STATE)
    sender.publish(STATE, state(2))
    eventually(lambda: reader.latest(STATE) is not None)
    assert reader.is_fresh(STATE)
    now_ns = time.monotonic_ns
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns() + round(1e9 * STALE_S))
    assert not reader.is_fresh(STATE)


def test_a_restarted_publisher_is_believed_and_its_ghost_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames of the dead predecessor that arrive late are refused by their incarnation."""
    monkeypatch.setattr(bus_module, "time", SimpleNamespace(monotonic_ns=lambda: 10**12))
    hub = MemoryHub()
    first, second = MemoryBus(hub, publishes=[STATE]), MemoryBus(hub, publishes=[STATE])
    reader = MemoryBus(hub, reads=[STATE])
    first.publish(STATE, state(7))
    assert reader.latest(STATE) is not None
    second.publish(STATE, state(0))
    assert reader.latest(STATE).body.tick == 0  # type: ignore[union-attr]
    first.publish(STATE, state(8))
    assert reader.latest(STATE) is None
    assert reader.reports()[0].refused == {"old_incarnation": 1}


def test_a_repeated_frame_is_refused() -> None:
    hub = MemoryHub()
    reader = MemoryBus(hub, reads=[STATE])
    data = protocol.encode(Frame(1, STATE, 1, 5, 9, time.monotonic_ns(), 0, True, state(1)))
    for _ in range(2):
        hub.send(STATE, data)
        reader.latest(STATE)
    assert reader.reports()[0].received == 1
    assert reader.reports()[0].refused == {"out_of_order": 1}


def test_a_peer_of_another_version_is_refused_by_name_and_the_next_frame_is_read() -> None:
    hub = MemoryHub()
    sender, reader = MemoryBus(hub, publishes=[STATE]), MemoryBus(hub, reads=[STATE])
    frame = Frame(protocol.PROTOCOL_VERSION, STATE, 2, 5, 0, 0, 0, True, state(1))
    for strange in (frame, msgspec.structs.replace(frame, protocol=9)):
        hub.send(STATE, protocol.encode(strange))
        assert reader.latest(STATE) is None
    sender.publish(STATE, state(3))
    assert reader.latest(STATE) is not None
    assert reader.reports()[0].refused == {"newer_version": 1, "protocol_version": 1}


def test_a_flood_is_refused_beyond_three_times_the_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns = 10**12
    monkeypatch.setattr(bus_module, "time", SimpleNamespace(monotonic_ns=lambda: now_ns))
    hub = MemoryHub()
    sender, reader = MemoryBus(hub, publishes=[STATE]), MemoryBus(hub, reads=[STATE])
    for tick in range(3000):
        now_ns += 50_000
        sender.publish(STATE, state(tick))
        reader.latest(STATE)
    report = reader.reports()[0]
    assert report.received == pytest.approx(bus_module.FLOOD_BURST + 3000.0 * 0.15, abs=1)
    assert report.refused["flood"] == 3000 - report.received


def _said(tick: int, sent_ns: int) -> bytes:
    return protocol.encode(
        Frame(protocol.PROTOCOL_VERSION, STATE, protocol.topic(STATE).version, 5, tick, sent_ns, 0, True, state(tick))
    )


@pytest.mark.parametrize(("times_the_rate", "floods"), [(1.0, False), (2.9, False), (4.0, True), (50.0, True)])
@pytest.mark.parametrize("reads_every_ms", [1, 300])
def test_who_keeps_the_newest_only_sees_a_flood_by_numbers_and_times(
    times_the_rate: float, floods: bool, reads_every_ms: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However seldom it reads itself: a reader that was held up is not one that is flooded."""
    now_ns = 0
    monkeypatch.setattr(bus_module, "time", SimpleNamespace(monotonic_ns=lambda: now_ns))
    hub, told = MemoryHub(), []
    reader = MemoryBus(hub, reads=[STATE])
    reader.on_flood = lambda: told.append(1)
    n_sent = round(1000 * times_the_rate)
    for tick in range(n_sent):
        now_ns = round(tick * 1e6 / times_the_rate)
        hub.send(STATE, _said(tick, now_ns))
        if tick % round(reads_every_ms * times_the_rate) == 0:
            reader.latest(STATE)
    assert bool(told) is floods
    beyond = n_sent - 3000
    expected = {STATE: pytest.approx(0.9 * beyond, rel=0.12)} if floods else {}  # the last tenth may not be read yet
    assert reader.floods() == expected


@pytest.mark.parametrize(("apart_ms", "floods"), [(100, False), (1, True)])
def test_what_waited_for_a_reader_that_was_late_is_no_flood(apart_ms: int, floods: bool) -> None:
    """A gateway that had built for half a minute refused words of the supervisor, and called that a flood."""
    row, told = protocol.topic("supervisor.state"), []
    inbox = bus_module.Inbox(row, on_flood=lambda: told.append(1))
    body = bodies.SupervisorState(state="starting")
    for number in range(300):
        sent_ns = number * apart_ms * 1_000_000
        frame = Frame(protocol.PROTOCOL_VERSION, row.name, row.version, 5, number, sent_ns, 0, True, body)
        inbox.accept(protocol.encode(frame))
        inbox._tokens = max(inbox._tokens, float(number % 10 == 0))  # as time passes
    assert inbox.refused["flood"] > 100
    assert bool(told) is floods


def test_a_publisher_that_starts_anew_is_no_flood() -> None:
    hub = MemoryHub()
    reader = MemoryBus(hub, reads=[STATE])
    hub.send(STATE, _said(0, 0))
    reader.latest(STATE)
    for _ in range(3):
        first = MemoryBus(hub, publishes=[STATE])
        for _ in range(40):
            first.publish(STATE, state(1))
        reader.latest(STATE)
        first.publish(STATE, state(1))
        reader.latest(STATE)
    assert reader.floods() == {}


def test_a_flood_on_the_real_bus_leaves_the_reader_with_the_newest(
    transport: Transport, eventually: Eventually
) -> None:
    sender, reader = ZmqBus(transport, publishes=[STATE]), ZmqBus(transport, reads=[STATE])
    try:
        connected(sender, eventually, reader)
        for tick in range(20_000):
            sender.publish(STATE, state(tick))
        assert reader.latest(STATE) is not None, "of those that came before the pipe was full"
        got: list[int] = []

        def newest() -> bool:
            frame = reader.latest(STATE)
            if frame is not None:
                got.append(frame.body.tick)
            return bool(got) and got[-1] == 20_000

        time.sleep(0.05)
        sender.publish(STATE, state(20_000))  # what came last in the flood may have found the pipe full
        eventually(newest)
        assert len(got) < 200
    finally:
        sender.close()
        reader.close()


def test_a_slow_reader_loses_frames_counts_them_and_delays_nobody(
    transport: Transport, eventually: Eventually, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reader of every frame sleeps; the sender and another reader do not notice."""
    sender = ZmqBus(transport, publishes=[STATE])
    slow, quick = ZmqBus(transport, reads_every=[STATE]), ZmqBus(transport, reads=[STATE])
    try:
        eventually(
            lambda: (
                (quick.latest(STATE) or sender.has_reader(STATE))
                and sender._batches[STATE].readers == sender._direct_senders[STATE].readers == 1
            )
        )
        total = 10_000
        now_ns = time.monotonic_ns()
        with monkeypatch.context() as patch:
            patch.setattr(
                "trocar.services.runtime.bus.zmq_bus.time.monotonic_ns", lambda: now_ns
            )  # all at once, on any machine
            for tick in range(total):  # ends: what the slow one does not take is lost, not waited for
                sender.publish(STATE, state(tick))
        assert quick.latest(STATE) is not None, "of those that came before its pipe was full"
        time.sleep(0.05)
        sender.publish(STATE, state(total))
        eventually(lambda: bool((f := quick.latest(STATE)) and f.body.tick == total))
        read: list[int] = []
        sent = total

        def has_the_newest() -> bool:
            nonlocal sent
            sent += 1
            sender.publish(STATE, state(sent))
            time.sleep(1.0 / SENDS_PER_S)  # with the next one leaves what was kept
            read.extend(frame.body.tick for frame in slow.drain(STATE))
            return bool(read) and read[-1] > total

        eventually(has_the_newest)
        report = slow.reports()[0]
        assert report.received == len(read)
        assert sum(tick <= total for tick in read) < total
        assert len(read) + report.dropped == read[-1] + 1, "each frame was either read or counted as lost"
    finally:
        for each in (sender, slow, quick):
            each.close()


def test_waiting_ends_at_its_time_or_with_a_frame(transport: Transport, eventually: Eventually) -> None:
    sender, reader = ZmqBus(transport, publishes=[STATE]), ZmqBus(transport, reads=[STATE])
    try:
        connected(sender, eventually, reader)
        until = time.monotonic_ns() + 700_000
        assert not reader.wait(STATE, until)
        assert time.monotonic_ns() >= until
        sender.publish(STATE, state(1))
        assert reader.wait(STATE, time.monotonic_ns() + 10**9)
        assert reader.latest(STATE) is not None
    finally:
        sender.close()
        reader.close()


def _wakeups_of_the_bus() -> int:
    """Return how often threads of libzmq in this process have slept."""
    tasks = [task for task in Path("/proc/self/task").iterdir() if (task / "comm").read_text().startswith("ZMQbg/IO")]
    lines = [line for task in tasks for line in (task / "status").read_text().splitlines()]
    return sum(int(line.split()[1]) for line in lines if line.startswith("voluntary_ctxt_switches"))


def test_a_publisher_that_is_not_there_is_asked_for_ever_more_rarely_and_heard_when_it_comes(
    transport: Transport, eventually: Eventually
) -> None:
    reader = ZmqBus(transport, reads=["visualization.health"], reads_every=[STATE], samples=["physics.state"])
    try:
        time.sleep(0.3)
        before = _wakeups_of_the_bus()
        time.sleep(1.0)
        assert _wakeups_of_the_bus() - before < 300, "three topics, of which each would be asked for 500 times"
        late = ZmqBus(transport, publishes=["visualization.health"])
        try:
            eventually(lambda: late.has_reader("visualization.health"))
        finally:
            late.close()
    finally:
        reader.close()


def test_an_endpoint_has_one_owner(transport: Transport) -> None:
    """A second bind on an ipc path would succeed and steal it: the lock refuses, and says who has it."""
    first = ZmqBus(transport, publishes=[STATE])
    with pytest.raises(BusError, match=r"topic gateway.state is already published by process \d+"):
        ZmqBus(transport, publishes=[STATE])
    first.close()
    ZmqBus(transport, publishes=[STATE]).close()


@pytest.mark.parametrize("kind", ["ipc", "tcp"])
def test_a_publisher_is_known_on_its_host_whatever_the_transport(
    transport: Transport, kind: Literal["ipc", "tcp"]
) -> None:
    """Over TCP it was not: a second rig could start in the same directory, and `trocar down` saw none."""
    transport = Transport(kind=kind, base_port=base_port(22_600), directory=transport.directory)
    sender = ZmqBus(transport, publishes=["gateway.health"])
    assert lock_holders(transport) == {"gateway": os.getpid()}
    sender.close()
    assert lock_holders(transport) == {}


def test_a_lock_that_was_removed_while_it_was_opened_is_not_taken(
    transport: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two publishers could each hold a lock, one of them on a file that is gone."""
    flock = fcntl.flock

    def late(lock: IO[str], how: int) -> None:
        monkeypatch.setattr(fcntl, "flock", flock)
        with endpoints.all_claimed(transport):
            pass
        flock(lock, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with (
        endpoints.claim(transport, STATE),
        pytest.raises(BusError, match="already published"),
        endpoints.claim(transport, STATE),
    ):
        pass


def test_who_closes_leaves_no_socket_behind_and_takes_nobody_elses(transport: Transport) -> None:
    """A path without its publisher is one that readers try in vain."""
    assert transport.directory is not None
    first, other = (
        ZmqBus(transport, publishes=[STATE, "gateway.health"]),
        ZmqBus(transport, publishes=["physics.state"]),
    )
    with pytest.raises(BusError):
        ZmqBus(transport, publishes=["supervisor.state", STATE])
    first.close()
    sockets = {path.name for path in transport.directory.glob("*.ipc")}
    other.close()
    assert sockets == {"physics.state.ipc", "physics.state.whole.ipc"}
    assert not list(transport.directory.glob("*.ipc"))


def test_a_taken_port_is_one_sentence() -> None:
    transport = Transport(kind="tcp", base_port=base_port(22_000))
    context = zmq.Context()
    blocker = context.socket(zmq.PUB)
    blocker.bind(endpoint(transport, STATE))
    try:
        with pytest.raises(BusError, match=r"topic gateway.state: cannot bind tcp://127.0.0.1:\d+: Address already"):
            ZmqBus(transport, publishes=[STATE])
    finally:
        context.destroy(linger=0)


def test_a_socket_path_that_is_too_long_is_one_sentence(transport: Transport) -> None:
    assert transport.directory is not None
    deep = Transport(directory=transport.directory / ("x" * 90))
    with pytest.raises(BusError, match=r"transport.directory: the socket path .* the system allows 107"):
        ZmqBus(deep, publishes=[STATE])


def test_garbage_on_the_socket_is_counted_and_survived(transport: Transport, eventually: Eventually) -> None:
    context = zmq.Context()
    peer = context.socket(zmq.XPUB)
    peer.bind(endpoint(transport, batch_endpoint(STATE)))
    reader = ZmqBus(transport, reads_every=[STATE])
    try:
        eventually(lambda: bool(peer.poll(10)))
        for data in (b"", b"\xc1", b"\xdd\xff\xff\xff\xff", b"x" * (1 << 21)):
            peer.send(data)
        eventually(lambda: not reader.drain(STATE) and sum(reader.reports()[0].refused.values()) == 4)
        assert reader.reports()[0].refused == {"malformed": 3, "too_large": 1}
    finally:
        reader.close()
        context.destroy(linger=0)


def test_a_sampler_gets_a_new_frame_when_it_asks_and_nothing_between(make: Make, eventually: Eventually) -> None:
    sender, reader = make(publishes=[STATE]), make(samples=[STATE])
    eventually(lambda: sender.publish(STATE, state(0)) >= 0 and bool(_sample_while_sending(sender, reader)))
    received = reader.reports()[0].received
    time.sleep(0.02)
    for _ in range(50):
        sender.publish(STATE, state(1))
    assert reader.reports()[0].received == received


def _sample_while_sending(sender: Any, reader: Any) -> dict[str, Frame]:
    """Send from another thread while this one waits, as another process would."""
    if isinstance(reader, MemoryBus):
        return reader.sample([STATE], 0)
    stop = threading.Event()

    def send() -> None:
        while not stop.is_set():
            sender.publish(STATE, state(5))
            time.sleep(1e-3)

    thread = threading.Thread(target=send)
    thread.start()
    try:
        frames: dict[str, Frame] = reader.sample([STATE], time.monotonic_ns() + 500_000_000)
    finally:
        stop.set()
        thread.join()
    return frames


def test_a_sample_that_does_not_come_is_left_out(transport: Transport) -> None:
    sender, reader = ZmqBus(transport, publishes=[STATE]), ZmqBus(transport, samples=[STATE])
    try:
        before = time.monotonic_ns()
        assert reader.sample([STATE], before + 3_000_000) == {}
        assert time.monotonic_ns() >= before + 3_000_000
    finally:
        sender.close()
        reader.close()


def test_a_frame_that_somebody_waits_for_lets_the_thread_of_the_bus_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """That thread has the priority of the process: it runs when the process sleeps, or here."""
    yielded: list[int] = []
    transport = Transport(kind="tcp", base_port=base_port(23_000))
    sender = ZmqBus(transport, publishes=[STATE])
    monkeypatch.setattr("os.sched_yield", lambda: yielded.append(sender._out[STATE].sent))
    try:
        for at_once in (False, True, False):
            sender.publish(STATE, state(0), at_once=at_once)
        assert yielded == [2], "after the second frame was sent"
    finally:
        sender.close()
