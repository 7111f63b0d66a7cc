"""What is done about a breach that stands: lower the quality, then restart, then stop safely. Pure decisions.

Each rung is given time to show its effect, and more than one window: a single stall of the machine fills one window
and climbs nothing. A breach that is only slight stays on the last quality level as DEGRADED with its reason: a restart
would cost the hand more than it could gain.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from services.supervisor.contracts import Breach


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
        Quality levels that the scene has; 1 where there is nothing to lower.
    patience_s
        How long a breach stands before each rung.
    calm_s
        How long nothing may stand before a better level is tried; doubles with each try that failed.
    may_restart
        False where another keeps the processes alive: judge and command only.
    """

    levels: int = 1
    patience_s: float = 5.0
    calm_s: float = 20.0
    may_restart: bool = True


class Enforcement:
    """The ladder's memory: level in force, who was restarted already, since when things stand as they do."""

    def __init__(self, ladder: Ladder) -> None:
        self.ladder = ladder
        self.level = 0
        self._restarted: set[str] = set()
        self._standing_since_s: float | None = None
        self._calm_since_s: float | None = None
        self._calm_s = ladder.calm_s
        self._raised = False

    def decide(self, now_s: float, standing: list[Breach]) -> Action | None:
        """Return what to do now about the `standing` breaches of critical processes, worst first; mostly nothing."""
        if not standing:
            self._standing_since_s = None
            return self._recover(now_s)
        self._calm_since_s = None
        if self._standing_since_s is None:
            self._standing_since_s = now_s
        if now_s - self._standing_since_s < self.ladder.patience_s:
            return None
        self._standing_since_s = now_s
        return self._climb(next((breach for breach in standing if breach.severe), standing[0]))

    def reset(self) -> None:
        """Begin at the first rung: a person has armed the rig anew. The quality level stays."""
        self._restarted.clear()
        self._standing_since_s = None

    def _climb(self, worst: Breach) -> Action | None:
        if self.level < self.ladder.levels - 1:
            if self._raised:
                self._calm_s *= 2
                self._raised = False
            self.level += 1
            return Action(Rung.LOWER, worst.process, worst.text)
        if not worst.severe:
            return None
        if self.ladder.may_restart and worst.process not in self._restarted:
            self._restarted.add(worst.process)
            return Action(Rung.RESTART, worst.process, worst.text)
        return Action(Rung.SAFE_STOP, worst.process, worst.text)

    def _recover(self, now_s: float) -> Action | None:
        if self._calm_since_s is None:
            self._calm_since_s = now_s
        if now_s - self._calm_since_s < self._calm_s:
            return None
        self._calm_since_s = now_s
        self._restarted.clear()
        if self.level == 0:
            self._calm_s = self.ladder.calm_s
            return None
        self.level -= 1
        self._raised = True
        return Action(Rung.RAISE, "", f"no contract broken for {self._calm_s:.0f} s")
