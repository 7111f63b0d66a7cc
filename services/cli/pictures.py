"""``trocar replay --pictures``: what was recorded is shown again, and nothing is simulated."""

from __future__ import annotations

import select
import sys
import time
from collections.abc import Callable
from pathlib import Path

from services.recordings.errors import RecordingError
from services.recordings.reader import RecordedFrame, read_frames
from services.runtime.bus import Bus
from services.supervisor.supervisor import Supervisor

TOPICS = ("gateway.state", "physics.state")
#: What runs none of it.
IDLE = tuple(f"processes.{name}.enabled=false" for name in ("gateway", "haptics", "physics", "recorder"))
HELP = "Enter: halt or go on; s: a step; +5, -5: seconds ahead or back; x0.5: that rate"


class Player:
    """Publishes the newest recorded frames, again and again, as the picture asks for them.

    Attributes
    ----------
    place_s
        Seconds since the recording's first frame.
    """

    def __init__(self, path: Path, bus: Bus, rate: float, until_s: float | None, *, loop: bool) -> None:
        self._path, self._bus, self._loop = path, bus, loop
        self.rate, self.halted, self.place_s = rate, False, 0.0
        self._until_s = float("inf") if until_s is None else until_s
        self._last_ns = time.monotonic_ns()
        self._begin()

    def _begin(self) -> None:
        self._frames = read_frames(self._path, TOPICS)
        self._next: RecordedFrame | None = next(self._frames, None)
        if self._next is None:
            raise RecordingError(f"{self._path}: holds nothing to show")
        self._first_ns = self._next.time_ns
        self._shown: dict[str, RecordedFrame] = {}

    def turn(self) -> bool:
        """Publish what is due; return whether the end is reached."""
        now_ns = time.monotonic_ns()
        if not self.halted:
            self.place_s += self.rate * (now_ns - self._last_ns) * 1e-9
        self._last_ns = now_ns
        self._take()
        is_over = self._next is None or self.place_s >= self._until_s
        if is_over and self._loop:
            self.seek(0.0)
        for shown in self._shown.values():
            self._bus.publish(shown.frame.topic, shown.frame.body, origin_ns=now_ns)
        return is_over and not self._loop

    def seek(self, place_s: float) -> None:
        """Go to a second of the recording."""
        if place_s < self.place_s:
            self._begin()
        self.place_s = max(0.0, place_s)
        self._take()

    def step(self) -> None:
        """Halt, and show the next state of physics."""
        self.halted = True
        before = self._shown.get("physics.state")
        while self._next is not None and self._shown.get("physics.state") is before:
            self.place_s = (self._next.time_ns - self._first_ns) * 1e-9
            self._take()

    def obey(self, line: str) -> None:
        """Do what a person has typed; what is none of `HELP` is not heard."""
        try:
            if not line:
                self.halted = not self.halted
            elif line == "s":
                self.step()
            elif line[0] in "+-":
                self.seek(self.place_s + float(line))
            elif line[0] == "x":
                self.rate = max(0.0, float(line[1:]))
        except ValueError:
            return

    def _take(self) -> None:
        while self._next is not None and (self._next.time_ns - self._first_ns) * 1e-9 <= self.place_s:
            self._shown[self._next.frame.topic] = self._next
            self._next = next(self._frames, None)


def shown_by(open_player: Callable[[], Player]) -> Callable[[Supervisor], bool]:
    """Return what lets the rig's every turn show the recording, and hears what is typed.

    The player is opened in the first turn: before, what it publishes would be another rig's.
    """
    players: list[Player] = []

    def turn(_supervisor: Supervisor) -> bool:
        player = players[0] if players else open_player()
        players[:] = [player]
        if sys.stdin.isatty() and select.select([sys.stdin], [], [], 0.0)[0]:
            player.obey(sys.stdin.readline().strip())
        return player.turn()

    return turn
