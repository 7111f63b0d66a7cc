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

from trocar.protocol import Frame
from trocar.review.attempts.assess import Message, Terms, assess
from trocar.review.attempts.assessment import Assessment
from trocar.services.runtime.bus import Bus
from trocar.services.runtime.rig import Rig
from trocar.services.runtime.tick_grid import GridFilter
from trocar.services.runtime.zmq_bus import ZmqBus

_FAST = ("gateway.state", "haptics.contacts", "physics.state")
_TOLD = ("training.attempt", "supervisor.state")
_TURN_S = 0.08
_SAMPLE_S = 0.04


class Listener:
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
        whole = _FAST if self._rig.simulated_time else ()
        sampled = [each for each in _FAST if each not in whole]
        bus = ZmqBus(self._rig.transport, reads_every=(*_TOLD, *whole), samples=sampled)
        try:
            for found in assess(_ordered(_frames(bus, whole, sampled, self._ending)), self._terms):
                recording = newest_recording(self._rig.recorder.directory)
                self._take(found, recording)
        finally:
            bus.close()


def _frames(bus: Bus, whole: tuple[str, ...], sampled: list[str], ending: threading.Event) -> Iterator[list[Message]]:
    """Yield what has come since the last turn."""
    grid = {topic: GridFilter() for topic in whole if topic != "gateway.state"}
    while not ending.wait(_TURN_S if whole else _SAMPLE_S):
        found: list[Message] = []
        for topic in (*_TOLD, *whole):
            while batch := bus.batch(topic):
                frames = batch.frames()
                found += [(each.topic, each.sent_ns, each.body) for each in _on_grid(grid.get(topic), frames)]
        sample = bus.sample(sampled, time.monotonic_ns() + 20_000_000) if sampled else {}
        yield [*found, *((topic, frame.sent_ns, frame.body) for topic, frame in sample.items())]


def _on_grid(grid: GridFilter | None, frames: list[Frame]) -> list[Frame]:
    return frames if grid is None else list(grid.chosen(frames))


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
