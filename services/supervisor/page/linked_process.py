"""A process of its own beside the rig, at the other end of a link: started, ended, started again if it is lost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from trocar.services.supervisor.crew.crew import END_S
from trocar.services.supervisor.crew.launcher import Child
from trocar.services.supervisor.crew.processes import ProcessSpec
from trocar.services.supervisor.crew.restart_policy import MINUTE_S, helper_restarts
from trocar.services.supervisor.crew.silence import Silence
from trocar.services.supervisor.page.page_link import Heartbeat, Link

#: Silence that is a hang, of one that runs and of one that starts, not counting waits for a processor.
SILENT_S, _SILENT_AT_FIRST_S = 5.0, 60.0


class LinkedProcess:
    """Starts the process, and again if it ends or hangs; it ends once its link is closed.

    Args:
        spec: What to start.
        log_file: Where its output goes.
        setup: Its first message.
        descriptors: What it gets as further arguments, beside the descriptor of its link.
        say: Tells a person what happened: level and text.
        beats: Whether it sends a `Heartbeat` at least every few seconds.

    Attributes:
        link: The link to it while it lives, else None.
    """

    def __init__(
        self,
        spec: ProcessSpec,
        log_file: Path,
        setup: msgspec.Struct,
        say: Callable[[str, str], None],
        descriptors: Sequence[int] = (),
        *,
        beats: bool = False,
    ) -> None:
        self.link: Link | None = None
        self._child: Child | None = None
        self._silence: Silence | None = None
        self._due_s = 0.0
        self._spec, self._log_file, self._setup, self._say = spec, log_file, setup, say
        self._descriptors, self._beats = descriptors, beats
        self._restarts = helper_restarts()

    def start(self) -> None:
        """Start it."""
        self.link, other = Link.pair()
        self.link.send(self._setup)
        passed = other.fileno(), *self._descriptors
        self._child = Child(self._spec, [str(each) for each in passed], self._log_file, passed)
        other.close()
        self._silence = Silence(self._child.pid, _SILENT_AT_FIRST_S) if self._beats else None

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
        if self._silence is None or self.link is None:
            return ""
        try:
            while self.link.receive(Heartbeat) is not None:
                self._silence.await_answer(SILENT_S)
        except ConnectionError:  # it ends, and its end is noticed in a turn of its own
            return ""
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
        if self.link is not None:
            self.link.close()
        if self._silence is not None:
            self._silence.close()
        self._child = self.link = self._silence = None

    def end(self) -> None:
        """Let it end, without waiting for it."""
        if self.link is not None:
            self.link.close()

    def close(self) -> None:
        """End it, by force if it takes too long."""
        self.end()
        if self._child is not None:
            self._child.wait(END_S)
            self._child.kill()
            self._forget_child(self._child)
