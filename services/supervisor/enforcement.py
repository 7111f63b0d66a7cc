"""Decides what to do about a breach that stands: lower the quality, then restart, then stop safely. Pure.

Each step is given time to show its effect, and more than one window: a single stall of the machine fills one window
and climbs nothing. A breach that is only slight stays on the last quality level as DEGRADED with its reason: a restart
would cost the hand more than it could gain. So does one that is severe for a moment on top of a slight one that stands,
as on a machine that is too slow and then stalls: for a restart, severity itself has to stand. Which rung of quality is
given up, and when it is taken back, is the governor's. Where the host stood still, or somebody else had the processor,
less work would have spared nothing, and no quality is given up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum

from services.runtime.quality_governor import Hysteresis
from services.supervisor.contracts import Breach
from services.supervisor.governor import Governor, Level


class ActionKind(Enum):
    """What to do."""

    LOWER = "lower the quality level"
    RAISE = "raise the quality level"
    RESTART = "restart"
    SAFE_STOP = "safe stop"


@dataclass(frozen=True, slots=True)
class Action:
    """One step of enforcement, and the process that it concerns, if it does."""

    kind: ActionKind
    process: str
    reason: str


@dataclass(frozen=True, slots=True)
class Ladder:
    """How enforcement climbs.

    Args:
        levels: The scene's quality ladder; one rung where there is nothing to lower.
        patience_s: How long a breach stands before each step.
        sudden_s: How long one of the fast window stands before quality is lowered, which is cheap and taken back:
            longer than what a single stall leaves in that window.
        try_s: The same while a better rung is tried, where the one to return to is known to hold: longer than a single
            stall stands.
        may_restart: False where another keeps the processes alive: judge and command only.
        hysteresis: How slowly quality comes back.
    """

    levels: tuple[Level, ...] = (Level(),)
    patience_s: float = 5.0
    sudden_s: float = 2.5
    may_restart: bool = True
    try_s: float = 1.5
    hysteresis: Hysteresis = field(default_factory=Hysteresis)


class Severity:
    """Since when breaches have been severe. Less than `LAPSE_S` without ends nothing: ticks are lost in bursts."""

    #: As long as the fast window is, which one tick more or less takes over the limit and back.
    LAPSE_S = 1.0

    def __init__(self) -> None:
        self._spans: dict[str, tuple[float, float]] = {}

    def see(self, now_s: float, standing: Sequence[Breach]) -> None:
        """Take note of those that are severe now."""
        self._spans = {key: span for key, span in self._spans.items() if now_s - span[1] < self.LAPSE_S}
        for breach in standing:
            if breach.severe:
                self._spans[breach.key] = (self._spans.get(breach.key, (now_s,))[0], now_s)

    def stands(self, breach: Breach, now_s: float, for_s: float) -> bool:
        """Return whether `breach` is severe and has been for so long."""
        return breach.severe and now_s - self._spans[breach.key][0] >= for_s

    def clear(self) -> None:
        """Forget everything."""
        self._spans.clear()


class Enforcement:
    """The memory of enforcement: quality in force, processes restarted already, since when the breaches stand."""

    def __init__(self, ladder: Ladder) -> None:
        self.ladder = ladder
        self.governor = Governor(ladder.levels, ladder.hysteresis)
        self._restarted: set[str] = set()
        self._standing_since_s: float | None = None
        self._severity = Severity()

    @property
    def level(self) -> int:
        """The quality level in force."""
        return self.governor.level

    def decide(self, now_s: float, standing: list[Breach], spent_s: float = 0.0) -> Action | None:
        """Return what to do now about the `standing` breaches of critical processes, worst first; mostly nothing.

        ``spent_s`` is what was lost since the rung in force was taken, see `Governor.burns`.
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
        """Begin at the first rung: a person has armed the rig anew. The quality level stays."""
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
