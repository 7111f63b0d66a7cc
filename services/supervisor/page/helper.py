"""A process of its own beside the rig: started, ended, started again if it is lost.

Between it and the supervisor is a line by which either notices when the other has ended.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Sequence
from pathlib import Path

from trocar.services.supervisor.crew.crew import END_S
from trocar.services.supervisor.crew.launcher import Child
from trocar.services.supervisor.crew.processes import ProcessSpec
from trocar.services.supervisor.crew.restart_policy import MINUTE_S, helper_restarts
from trocar.services.supervisor.crew.silence import Silence

#: Silence that is a hang, of one that runs and of one that starts, not counting waits for a processor.
SILENT_S, _SILENT_AT_FIRST_S = 5.0, 60.0
#: Signs of life taken at once, as many as come in twelve seconds; the rest is for later turns.
_SIGNS = 64


class Lifeline:
    """One end of the line. Nothing goes over it but signs of life, and it never waits."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end

    @classmethod
    def pair(cls) -> tuple[Lifeline, Lifeline]:
        """Return both ends."""
        one, other = socket.socketpair()
        return cls(one), cls(other)

    @classmethod
    def of(cls, descriptor: int) -> Lifeline:
        """Return the end that a helper was given."""
        return cls(socket.socket(fileno=descriptor))

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._end.fileno()

    def beat(self) -> bool:
        """Give a sign of life, which one that does not listen loses; return whether the other end is there."""
        try:
            self._end.send(b"\0", socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except ConnectionError:
            return False
        except OSError:  # it does not listen now
            return True
        return True

    def heard(self) -> bool:
        """Return whether the other end has given a sign of life since the last call."""
        try:
            return bool(self._end.recv(_SIGNS, socket.MSG_DONTWAIT))
        except OSError:  # nothing, or it has ended with what was sent to it unread
            return False

    def close(self) -> None:
        """Close this end."""
        self._end.close()


class Helper:
    """Starts the process, and again if it ends or hangs; it ends once its lifeline is cut.

    Args:
        spec: What to start.
        log_file: Where its output goes.
        say: Tells a person what happened: level and text.
        place: The page's file, its first argument; the second is the descriptor of its lifeline.
        descriptors: What it gets as further arguments.
        beats: Whether it gives a sign of life at least every few seconds.
    """

    def __init__(
        self,
        spec: ProcessSpec,
        log_file: Path,
        say: Callable[[str, str], None],
        place: Path,
        descriptors: Sequence[int] = (),
        *,
        beats: bool = False,
    ) -> None:
        self._lifeline: Lifeline | None = None
        self._child: Child | None = None
        self._silence: Silence | None = None
        self._due_s = 0.0
        self._spec, self._log_file, self._place, self._say = spec, log_file, place, say
        self._descriptors, self._beats = descriptors, beats
        self._restarts = helper_restarts()

    def start(self) -> None:
        """Start it."""
        self._lifeline, other = Lifeline.pair()
        passed = other.fileno(), *self._descriptors
        self._child = Child(self._spec, [str(self._place), *map(str, passed)], self._log_file, passed)
        other.close()
        self._silence = Silence(self._child.pid, _SILENT_AT_FIRST_S) if self._beats else None

    @property
    def is_running(self) -> bool:
        """Whether it has been started, and its end not been noticed."""
        return self._child is not None

    def run_turn(self, now_s: float) -> None:
        """Start it if it is due; notice that it has ended, or hangs."""
        if self._child is None:
            if now_s >= self._due_s:
                self.start()
        elif self._child.end() is not None:
            self._lose(self._child, now_s)
        elif why := self._hear_beats():
            self._lose(self._child, now_s, f" {why} and")

    def _hear_beats(self) -> str:
        """Return what is wrong with it, empty for nothing."""
        if self._silence is None or self._lifeline is None:
            return ""
        if self._lifeline.heard():
            self._silence.await_answer(SILENT_S)
        return self._silence.too_long()

    def _lose(self, child: Child, now_s: float, why: str = "") -> None:
        """End one that ended or hangs, and say so."""
        status = child.kill()
        self._forget_child(child)
        delay_s = self._restarts.delay_s(now_s)
        self._due_s = now_s + (MINUTE_S if delay_s is None else delay_s)
        again = "the rig goes on without for a minute" if delay_s is None else "started again"
        text = f"the {self._spec.name}'s process{why} ended with exit code {status}, {again} (see {self._log_file})"
        self._say("warning", f"supervisor: {text}")

    def _forget_child(self, child: Child) -> None:
        child.close()
        self.end()
        if self._silence is not None:
            self._silence.close()
        self._child = self._lifeline = self._silence = None

    def end(self) -> None:
        """Let it end, without waiting for it."""
        if self._lifeline is not None:
            self._lifeline.close()

    def close(self) -> None:
        """End it, by force if it takes too long."""
        self.end()
        if self._child is not None:
            self._child.wait(END_S)
            self._child.kill()
            self._forget_child(self._child)
