"""A process of the ordinary class beside the supervisor, which is told what the supervisor makes of the rig.

It shares no interpreter with the loop that judges: one that is not run, or is busy, holds up nobody. It hears the
processes for itself. Its end of a socket pair is its life.
"""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

from services.supervisor.launcher import Child
from services.supervisor.notes import Command, Link, Opening, notes
from services.supervisor.processes import ProcessSpec
from services.supervisor.supervisor import Supervisor

_TELL_S = 0.2
#: One that ended is started again after so long, so often.
_RETRY_S, _RETRIES = 2.0, 5
_END_S = 3.0


class Companion:
    """Runs while it is open.

    Parameters
    ----------
    spec
        Its module gets the number of its end of the link, then the `descriptors`.
    opening
        The first message to it.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        spec: ProcessSpec,
        opening: Opening,
        log_file: Path,
        descriptors: tuple[int, ...] = (),
    ) -> None:
        self._supervisor = supervisor
        self._spec = spec
        self._opening = opening
        self._log_file = log_file
        self._descriptors = descriptors
        self._child: Child | None = None
        self._link: Link | None = None
        self._starts = 0
        self._due_s = self._retry_s = 0.0

    def __enter__(self) -> Self:
        self._start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._link is not None:
            self._link.close()  # which it sees, and ends
        if self._child is not None:
            self._child.wait(_END_S)
            self._child.kill()
            self._child.close()

    def turn(self, now_s: float) -> None:
        """Tell it what there is to tell, do what it asks, start it again where it ended."""
        if self._link is None or self._child is None:
            if now_s >= self._retry_s and self._starts <= _RETRIES:
                self._start()
            return
        try:
            self._obey(self._link)
        except ConnectionError:
            self._lost(now_s)
            return
        if now_s >= self._due_s:
            self._due_s = now_s + _TELL_S
            self._link.send(notes(self._supervisor, now_s))

    def _obey(self, link: Link) -> None:
        while (command := link.receive(Command)) is not None:
            act = self._supervisor.arm if command.what == "arm" else self._supervisor.safe_stop
            act(command.who)

    def _start(self) -> None:
        self._starts += 1
        self._link, other = Link.pair()
        self._link.send(self._opening)
        descriptors = (other.fileno(), *self._descriptors)
        self._child = Child.started(self._spec, [str(each) for each in descriptors], self._log_file, descriptors)
        other.close()

    def _lost(self, now_s: float) -> None:
        assert self._child is not None
        assert self._link is not None
        self._link.close()
        status = self._child.kill()
        self._child.close()
        self._child = self._link = None
        self._retry_s = now_s + _RETRY_S
        again = "started again" if self._starts <= _RETRIES else "given up; the rig goes on without"
        text = f"supervisor: the {self._spec.name}'s process ended with exit code {status}, {again}"
        self._supervisor.say("warning", f"{text} (see {self._log_file})")
