"""A process of its own beside the rig, at the other end of a link: started, ended, started again if it is lost."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from trocar.services.supervisor.crew.crew import END_S
from trocar.services.supervisor.crew.launcher import Child
from trocar.services.supervisor.crew.processes import ProcessSpec
from trocar.services.supervisor.crew.restart_policy import MINUTE_S, helper_restarts
from trocar.services.supervisor.page.page_link import Link


class LinkedProcess:
    """Starts the process; it ends once its link is closed.

    Args:
        spec: What to start.
        log_file: Where its output goes.

    Attributes:
        child: The process while it lives, else None.
        link: The link to it, likewise.
        due_s: When it may be started again.
    """

    def __init__(self, spec: ProcessSpec, log_file: Path) -> None:
        self.log_file = log_file
        self.child: Child | None = None
        self.link: Link | None = None
        self.due_s = 0.0
        self._spec = spec
        self._restarts = helper_restarts()

    def start(self, setup: msgspec.Struct, descriptors: Sequence[int] = ()) -> Child:
        """Start it; its arguments are the link's descriptor and further ones, and its first message is `setup`."""
        self.link, other = Link.pair()
        self.link.send(setup)
        passed = other.fileno(), *descriptors
        self.child = Child(self._spec, [str(each) for each in passed], self.log_file, passed)
        other.close()
        return self.child

    def lose(self, now_s: float) -> tuple[int, bool]:
        """Kill it, as it ended or hangs; return its exit status, and whether it is started again soon."""
        assert self.link is not None
        assert self.child is not None
        self.link.close()
        status = self.child.kill()
        self.child.close()
        self.child = self.link = None
        delay_s = self._restarts.delay_s(now_s)
        self.due_s = now_s + (MINUTE_S if delay_s is None else delay_s)
        return status, delay_s is not None

    def end(self) -> None:
        """Let it end, without waiting for it."""
        if self.link is not None:
            self.link.close()

    def close(self) -> None:
        """End it, by force if it takes too long."""
        self.end()
        if self.child is not None:
            self.child.wait(END_S)
            self.child.kill()
            self.child.close()
