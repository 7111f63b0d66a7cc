"""What is done about a breach that stands: lower the quality, then restart, then stop safely. Pure decisions.

Each rung is given time to show its effect, and more than one window: a single stall of the machine fills one window
and climbs nothing. A breach that is only slight stays on the last quality level as DEGRADED with its reason: a restart
would cost the hand more than it could gain. Which rung of quality is given up, and when it is taken back, is the
governor's.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from services.supervisor.contracts import Breach
from services.supervisor.governor import Governor, Hysteresis, Level


class Rung(Enum):
    """What to do."""

    LOWER = "lower the quality level"
    RAISE = "raise the quality level"
    RESTART = "restart"
    SAFE_STOP = "safe stop"


@dataclass(frozen=True, slots=True)
class Action:
    """One step of enforcement, on `process` where it concerns one."""

    rung: Rung
    process: str
    reason: str


@dataclass(frozen=True, slots=True)
class Ladder:
    """How enforcement climbs.

    Parameters
    ----------
    levels
        The scene's quality ladder; one rung where there is nothing to lower.
    patience_s
        How long a breach stands before each step.
    sudden_s
        How long one of the fast window stands before quality is lowered, which is cheap and taken back: longer than
        what a single stall leaves in that window.
    may_restart
        False where another keeps the processes alive: judge and command only.
    hysteresis
        How slowly quality comes back.
    """

    levels: tuple[Level, ...] = (Level(),)
    patience_s: float = 5.0
    sudden_s: float = 2.5
    may_restart: bool = True
    hysteresis: Hysteresis = field(default_factory=Hysteresis)


class Enforcement:
    """The ladder's memory: quality in force, who was restarted already, since when things stand as they do."""

    def __init__(self, ladder: Ladder) -> None:
        self.ladder = ladder
        self.governor = Governor(ladder.levels, ladder.hysteresis)
        self._restarted: set[str] = set()
        self._standing_since_s: float | None = None

    @property
    def level(self) -> int:
        """The quality level in force."""
        return self.governor.level

    def decide(self, now_s: float, standing: list[Breach]) -> Action | None:
        """Return what to do now about the `standing` breaches of critical processes, worst first; mostly nothing."""
        if not standing:
            self._standing_since_s = None
            return self._recover(now_s)
        self.governor.disturbed()
        if self._standing_since_s is None:
            self._standing_since_s = now_s
        if now_s - self._standing_since_s < self._patience_s(standing):
            return None
        self._standing_since_s = now_s
        self.governor.burns(now_s)
        return self._climb(next((breach for breach in standing if breach.severe), standing[0]))

    def reset(self) -> None:
        """Begin at the first rung: a person has armed the rig anew. The quality level stays."""
        self._restarted.clear()
        self._standing_since_s = None

    def _patience_s(self, standing: list[Breach]) -> float:
        may_be_quick = self.governor.can_lower and any(breach.sudden for breach in standing)
        return min(self.ladder.sudden_s, self.ladder.patience_s) if may_be_quick else self.ladder.patience_s

    def _climb(self, worst: Breach) -> Action | None:
        if self.governor.can_lower:
            before = self.governor.rung
            self.governor.lower()
            return Action(Rung.LOWER, worst.process, "; now ".join((worst.text, _told(self.governor.rung, before))))
        if not worst.severe:
            return None
        if self.ladder.may_restart and worst.process not in self._restarted:
            self._restarted.add(worst.process)
            return Action(Rung.RESTART, worst.process, worst.text)
        return Action(Rung.SAFE_STOP, worst.process, worst.text)

    def _recover(self, now_s: float) -> Action | None:
        if not self.governor.calm(now_s):
            return None
        self._restarted.clear()
        waited_s = self.governor.wait_s
        if not self.governor.come_back(now_s):
            return None
        return Action(Rung.RAISE, "", f"no contract broken for {waited_s:.0f} s; now {self.governor.rung.name!r}")


def _told(rung: Level, before: Level) -> str:
    measured = rung.against(before)
    return f"{rung.name!r}, {measured}" if measured else repr(rung.name)
