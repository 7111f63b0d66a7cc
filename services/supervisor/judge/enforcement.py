"""Decides on actions against standing breaches: lower the quality, then restart, then stop safely. Pure.

Each step gets time to show its effect, and more than one window, so that a single stall of the machine, which fills one
window, triggers nothing. A slight breach at the last quality level remains DEGRADED with its reason, as a restart would
cost the hand more than it gains. The same holds for a momentarily severe breach on top of a standing slight one, as on
a slow machine that stalls: a restart requires standing severity. The governor chooses the quality level to take, and
when to return. If the host was stopped or another process had the processor, less work would not have helped, and the
quality is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum

from trocar.services.runtime.loop.quality_governor import Hysteresis
from trocar.services.supervisor.judge.contracts import Breach
from trocar.services.supervisor.judge.governor import Governor, Level


class ActionKind(Enum):
    """Kinds of action."""

    LOWER = "lower the quality level"
    RAISE = "raise the quality level"
    RESTART = "restart"
    SAFE_STOP = "safe stop"


@dataclass(frozen=True, slots=True)
class Action:
    """One step of enforcement, and the process concerned, if any."""

    kind: ActionKind
    process: str
    reason: str


@dataclass(frozen=True, slots=True)
class Ladder:
    """Parameters of the escalation.

    Args:
        levels: The scene's quality ladder; a single level if there is nothing to lower.
        patience_s: How long a breach stands before each step.
        sudden_s: How long a breach of the fast window stands before quality is lowered, which is cheap and reversible:
            longer than a single stall affects that window.
        try_s: The same while a better level is tried, as the one to return to is known to hold: longer than the effect
            of a single stall.
        may_restart: False if others manage the processes, and this only judges and commands.
        hysteresis: How slowly quality comes back.
    """

    levels: tuple[Level, ...] = (Level(),)
    patience_s: float = 5.0
    sudden_s: float = 2.5
    may_restart: bool = True
    try_s: float = 1.5
    hysteresis: Hysteresis = field(default_factory=Hysteresis)


class Severity:
    """Durations of severe breaches; gaps below `LAPSE_S` do not end them, as ticks are lost in bursts."""

    #: Length of the fast window, in which a single tick more or less can cross the limit.
    LAPSE_S = 1.0

    def __init__(self) -> None:
        self._spans: dict[str, tuple[float, float]] = {}

    def see(self, now_s: float, standing: Sequence[Breach]) -> None:
        """Record the severe breaches of now."""
        self._spans = {key: span for key, span in self._spans.items() if now_s - span[1] < self.LAPSE_S}
        for breach in standing:
            if breach.severe:
                self._spans[breach.key] = (self._spans.get(breach.key, (now_s,))[0], now_s)

    def stands(self, breach: Breach, now_s: float, for_s: float) -> bool:
        """Return whether `breach` is severe and has been for `for_s`."""
        return breach.severe and now_s - self._spans[breach.key][0] >= for_s

    def clear(self) -> None:
        """Clear the state."""
        self._spans.clear()


class Enforcement:
    """State of enforcement: present quality, processes already restarted, and durations of the breaches."""

    def __init__(self, ladder: Ladder) -> None:
        self.ladder = ladder
        self.governor = Governor(ladder.levels, ladder.hysteresis)
        self._restarted: set[str] = set()
        self._standing_since_s: float | None = None
        self._severity = Severity()

    @property
    def level(self) -> int:
        """The present quality level."""
        return self.governor.level

    def decide(self, now_s: float, standing: list[Breach], spent_s: float = 0.0) -> Action | None:
        """Return the action against the `standing` breaches of critical processes, worst first; mostly None.

        ``spent_s`` is the loss since the present level was taken, see `Governor.burns`.
        """
        self._severity.see(now_s, standing)
        if not standing:
            self._standing_since_s = None
            return self._recover(now_s)
        self.governor.disturbed(now_s)
        if self._standing_since_s is None:
            self._standing_since_s = now_s
        if now_s - self._standing_since_s < self._patience_s(now_s, standing):
            return None
        self._standing_since_s = now_s
        by_work = [breach for breach in standing if breach.by_work]
        if by_work:
            self.governor.burns(now_s, spent_s)
        return self._give_up(by_work) if by_work and self.governor.can_lower else self._climb(now_s, standing)

    def reset(self) -> None:
        """Restart the escalation, as a person has armed the rig; the quality level is kept."""
        self._restarted.clear()
        self._standing_since_s = None
        self._severity.clear()

    def _patience_s(self, now_s: float, standing: list[Breach]) -> float:
        if not (self.governor.can_lower and any(breach.sudden and breach.by_work for breach in standing)):
            return self.ladder.patience_s
        sudden_s = self.ladder.try_s if self.governor.is_trying(now_s) else self.ladder.sudden_s
        return min(sudden_s, self.ladder.patience_s)

    def _give_up(self, standing: list[Breach]) -> Action:
        worst = next((breach for breach in standing if breach.severe), standing[0])
        before = self.governor.rung
        self.governor.lower(by_far=worst.severe)
        return Action(ActionKind.LOWER, worst.process, "; now ".join((worst.text, _told(self.governor.rung, before))))

    def _climb(self, now_s: float, standing: list[Breach]) -> Action | None:
        patience_s = self.ladder.patience_s
        worst = next((breach for breach in standing if self._severity.stands(breach, now_s, patience_s)), None)
        if worst is None:
            return None
        if self.ladder.may_restart and worst.process not in self._restarted:
            self._restarted.add(worst.process)
            return Action(ActionKind.RESTART, worst.process, worst.text)
        return Action(ActionKind.SAFE_STOP, worst.process, worst.text)

    def _recover(self, now_s: float) -> Action | None:
        if not self.governor.calm(now_s):
            return None
        self._restarted.clear()
        waited_s = self.governor.wait_s
        if not self.governor.come_back(now_s):
            return None
        return Action(ActionKind.RAISE, "", f"no contract broken for {waited_s:.0f} s; now {self.governor.rung.name!r}")


def _told(rung: Level, before: Level) -> str:
    measured = rung.against(before)
    return f"{rung.name!r}, {measured}" if measured else repr(rung.name)
