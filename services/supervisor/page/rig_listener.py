"""What an observer of a rig hears: the reports of its processes, and its supervisor's state and judgement."""

from __future__ import annotations

from collections.abc import Iterable

import trocar.protocol.bodies as bodies
from trocar.protocol import PROCESSES
from trocar.services.runtime.bus.bus import Bus
from trocar.services.supervisor.judge.figures import Figures
from trocar.services.supervisor.page.dashboard import Heard

STATE, JUDGEMENT = "supervisor.state", "supervisor.judgement"
#: All topics that it reads.
TOPICS = (STATE, JUDGEMENT, *(f"{name}.health" for name in PROCESSES))


class RigListener:
    """Hears a rig.

    Args:
        window_s: Figures are over so many last seconds.
        names: The processes that are heard, with the supervisor; what others say is not listened to.

    Attributes:
        heard: By process, what it has said of itself.
        state, judgement: The supervisor's newest, None before the first.
        judged_s: When the judgement came.
    """

    def __init__(self, window_s: float, names: Iterable[str] = PROCESSES) -> None:
        self.heard = {name: Heard(window_s) for name in names}
        self.state: bodies.SupervisorState | None = None
        self.judgement: bodies.Judgement | None = None
        self.judged_s = 0.0

    def hear_all(self, bus: Bus, now_s: float) -> None:
        """Take what has arrived."""
        for frame in bus.drain(STATE):
            self.state = frame.body
        if (told := bus.latest(JUDGEMENT)) is not None:
            self.judgement, self.judged_s = told.body, now_s
        for name, heard in self.heard.items():
            if (report := bus.latest(f"{name}.health")) is not None:
                heard.take_report(report.body)
                heard.heard_s = now_s

    @property
    def reports(self) -> dict[str, bodies.Health]:
        """The newest report of every process that was heard."""
        return {name: one.health for name, one in self.heard.items() if one.health is not None}

    @property
    def broken(self) -> frozenset[str]:
        """Keys of contracts that are broken, as far as the supervisor has told."""
        return frozenset(self.judgement.broken if self.judgement is not None else ())

    @property
    def starts(self) -> dict[str, str]:
        """What each process that has not come up does, and how much of that is done, as far as is told."""
        told = self.judgement.starts if self.judgement is not None else ()
        return {each.process: f"{each.stage}, {100.0 * each.fraction:.0f} %" for each in told}

    def figures(self) -> dict[str, Figures]:
        """Return the recent counts of every process."""
        return {name: one.figures for name, one in self.heard.items()}
