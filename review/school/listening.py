"""Listens to the rig's bus and judges each attempt as it ends, from the same frames as a recording has."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Metadata
from mcap.stream_reader import StreamReader

from trocar.protocol.topics import MOMENT_TICKS, TICK_NS, TICK_S
from trocar.review.attempts.assess import Message, Terms, assess
from trocar.review.attempts.assessment import Assessment
from trocar.services.runtime.bus.bus import Bus
from trocar.services.runtime.bus.zmq_bus import ZmqBus
from trocar.services.runtime.config.rig import Rig
from trocar.services.runtime.loop.tick_grid import MOMENTS, STATES, as_state

_TOLD = ("training.attempt", "supervisor.state")
_TURN_S = 2 * MOMENT_TICKS * TICK_S  # two moments, as it is read half as often as there are any
_SAMPLE_S = MOMENT_TICKS * TICK_S  # as often as there are moments in simulated time
_PATIENCE_NS = 20 * TICK_NS  # half a sample; the topics are sent each tick, so that nearly all come


class AttemptListener:
    """A thread that calls `take` with each attempt that has ended."""

    def __init__(self, rig: Rig, terms: Terms, take: Callable[[Assessment, Path | None], object]) -> None:
        self._rig, self._terms, self._take = rig, terms, take
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="listener", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Listen no more."""
        self._ending.set()
        self._thread.join(5.0)

    def _run(self) -> None:
        simulated = self._rig.simulated_time
        whole, samples = (MOMENTS, ()) if simulated else ((), STATES)
        bus = ZmqBus(self._rig.transport, reads_every=(*_TOLD, *whole), samples=samples)
        try:
            for found in assess(_ordered(_frames(bus, self._ending, simulated=simulated)), self._terms):
                self._take(found, newest_recording(self._rig.recorder.directory))
        finally:
            bus.close()


def _frames(bus: Bus, ending: threading.Event, *, simulated: bool) -> Iterator[list[Message]]:
    """Yield what has come since the last turn: all moments in simulated time, else a frame of each state topic."""
    while not ending.wait(_TURN_S if simulated else _SAMPLE_S):
        topics = (*_TOLD, *(MOMENTS if simulated else ()))
        frames = [as_state(frame) for topic in topics for frame in bus.drain(topic)]
        if not simulated:
            frames += bus.sample(STATES, time.monotonic_ns() + _PATIENCE_NS).values()
        yield [(frame.topic, frame.sent_ns, frame.body) for frame in frames]


def _ordered(turns: Iterator[list[Message]]) -> Iterator[Message]:
    """Yield messages in the order in which they were sent; those of the last turn wait for what is on its way."""
    waiting: deque[Message] = deque()
    for turn in turns:
        now_ns = time.monotonic_ns()
        waiting = deque(sorted((*waiting, *turn), key=lambda each: each[1]))
        while waiting and now_ns - waiting[0][1] > 2e9 * _TURN_S:
            yield waiting.popleft()


def newest_recording(folder: Path) -> Path | None:
    """Return the recording that is being written, None if there is none."""
    files = sorted(folder.glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns) if folder.is_dir() else []
    return files[-1].absolute() if files else None


def wall_minus_monotonic_ns(recording: Path | None) -> int:
    """Return the offset of a recording's times from the bus', so that an attempt has the same moment in both."""
    if recording is not None:
        try:
            with recording.open("rb") as file:
                for record in StreamReader(file, record_size_limit=1 << 20).records:
                    if isinstance(record, Metadata) and record.name == "trocar":
                        return int(record.metadata["wall_minus_monotonic_ns"])
        except (OSError, McapError, KeyError, ValueError):
            pass  # it is only begun, or of another kind: this process' own clocks tell it nearly as well
    return time.time_ns() - time.monotonic_ns()
