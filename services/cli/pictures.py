"""``trocar replay --pictures``: what was recorded is shown again, and nothing is simulated."""

from __future__ import annotations

import select
import sys
import time
from collections.abc import Callable
from pathlib import Path

import trocar.protocol.bodies as bodies
from trocar.services.recordings.errors import RecordingError
from trocar.services.recordings.reader import RecordedFrame, last_ns, read_frames
from trocar.services.runtime.bus.bus import Bus
from trocar.services.supervisor.control.supervisor import Supervisor

TOPICS = ("gateway.state", "physics.state")
_READ = (*TOPICS, "training.attempt")
#: What runs none of it.
IDLE = tuple(f"processes.{name}.enabled=false" for name in ("gateway", "haptics", "physics", "training", "recorder"))
HELP = (
    "Enter: halt or go on; s, b: a step on or back; +5, -5: seconds ahead or back; @12: to that second; "
    "x0.5: that rate; l: again and again, or once"
)
#: Every topic has told how it stands within so long, as the slowest comes ten times a second.
_BEFORE_S = 1.0
_MOST_RATE = 100.0  # an hour takes half a minute; nothing could be seen of one that is shown faster


class PicturePlayer:
    """Publishes the newest recorded frames, again and again, as the picture asks for them.

    It stays at the recording's end, so that one can go back; `until_s` ends it.

    Attributes:
        place_s: Seconds since the recording's first frame.
    """

    def __init__(self, path: Path, bus: Bus, rate: float, until_s: float | None, *, loop: bool) -> None:
        self._path, self._bus, self._loop = path, bus, loop
        self.rate, self.halted, self.place_s = rate, False, 0.0
        self._until_s = float("inf") if until_s is None else until_s
        self._last_ns = time.monotonic_ns()
        first = next(read_frames(path, TOPICS), None)
        if first is None:
            raise RecordingError(f"{path}: holds nothing to show")
        self._first_ns = first.time_ns
        self.length_s = (last_ns(path, TOPICS) - first.time_ns) * 1e-9
        self._begin_reading(0.0)

    def _begin_reading(self, place_s: float) -> None:
        """Read from a little before a place on."""
        from_ns = self._first_ns + round(max(0.0, place_s - _BEFORE_S) * 1e9)
        self._frames = read_frames(self._path, _READ, from_ns)
        self._next: RecordedFrame | None = next(self._frames, None)
        self._shown: dict[str, RecordedFrame] = {}

    def publish_due_frames(self) -> bool:
        """Publish what is due; return whether the end that was asked for is reached."""
        now_ns = time.monotonic_ns()
        if not self.halted:
            self.place_s = min(self.place_s + self.rate * (now_ns - self._last_ns) * 1e-9, self.length_s)
        self._last_ns = now_ns
        self._take_due_frames()
        is_over = self.place_s >= min(self._until_s, self.length_s)
        if is_over and self._loop and not self.halted:
            self.seek(0.0)
        for name in TOPICS:
            if name in self._shown:
                self._bus.publish(name, self._shown[name].frame.body, origin_ns=now_ns)
        return self.place_s >= self._until_s and not self._loop

    def seek(self, place_s: float) -> None:
        """Go to a second of the recording."""
        place_s = min(max(0.0, place_s), self.length_s)
        if not self.place_s <= place_s <= self.place_s + _BEFORE_S:
            self._begin_reading(place_s)
        self.place_s = place_s
        self._take_due_frames()

    def step(self) -> None:
        """Halt, and show the next state of physics."""
        self.halted = True
        before = self._shown.get("physics.state")
        while self._next is not None and self._shown.get("physics.state") is before:
            self.place_s = self._place_of(self._next)
            self._take_due_frames()

    def step_back(self) -> None:
        """Halt, and show the state of physics before the one that is shown."""
        self.halted = True
        for less_s in (1e-6, 0.0):  # to what was before, and then to its own moment
            if (shown := self._shown.get("physics.state")) is not None:
                self.seek(self._place_of(shown) - less_s)

    def obey(self, line: str) -> None:
        """Do what a person has typed, or asked for at the page; what is none of `HELP` is not heard."""
        match line[:1], line[1:]:
            case "", _:
                self.halted = not self.halted
            case "s", "":
                self.step()
            case "b", "":
                self.step_back()
            case "l", "":
                self._loop = not self._loop
            case "+" | "-" | "@" | "x" as what, words if (number := _number(words)) is not None:
                if what == "x":
                    self.rate = min(number, _MOST_RATE)
                else:
                    self.seek(number if what == "@" else self.place_s + (number if what == "+" else -number))

    def status(self) -> bodies.ReplayReport:
        """Return where the recording stands, with the attempt as it was told of then."""
        told = self._shown.get("training.attempt")
        return bodies.ReplayReport(
            file=self._path.name, place_s=self.place_s, length_s=self.length_s, rate=self.rate, halted=self.halted,
            loop=self._loop, attempt=None if told is None else told.frame.body,
        )  # fmt: skip

    def _place_of(self, frame: RecordedFrame) -> float:
        return (frame.time_ns - self._first_ns) * 1e-9

    def _take_due_frames(self) -> None:
        while self._next is not None and self._place_of(self._next) <= self.place_s:
            self._shown[self._next.frame.topic] = self._next
            self._next = next(self._frames, None)


def _number(words: str) -> float | None:
    """Return a number that is not negative, None for anything else."""
    try:
        number = float(words)
    except ValueError:
        return None
    return number if 0.0 <= number < float("inf") else None


def shown_by(open_player: Callable[[], PicturePlayer]) -> Callable[[Supervisor], bool]:
    """Return what lets the rig's every turn show the recording, and hears what is typed.

    The player is opened in the first turn: before, what it publishes would be another rig's.
    """
    players: list[PicturePlayer] = []

    def turn(supervisor: Supervisor) -> bool:
        player = players[0] if players else open_player()
        players[:] = [player]
        supervisor.shown = player
        if sys.stdin.isatty() and select.select([sys.stdin], [], [], 0.0)[0]:
            player.obey(sys.stdin.readline().strip())
        return player.publish_due_frames()

    return turn
