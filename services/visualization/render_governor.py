"""How finely a window draws: effects, then pixels, are given up until there are enough pictures a second. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from services.runtime.quality_governor import Hysteresis, Load, QualityGovernor
from services.visualization.render import Effects

#: Pictures a second below which something is given up: with a graphics processor, and in software.
WANTED_HZ, WANTED_IN_SOFTWARE_HZ = 24.0, 12.0
_JUDGE_S = 1.0
_SLOW_LOOKS = 2  # one slow second is chance
#: Of the time that there is for a picture, what one of the better rung may take as it is foreseen: by its pixels, or so
#: many times this one where it has more effects.
_ROOM, _MORE_EFFECTS = 0.9, 2.0
#: A return has failed whenever the next change is for the worse.
_HYSTERESIS = Hysteresis(calm_s=10.0, trial_s=math.inf)
#: Asked for beyond what was painted, so that a window that can paint more shows it; and in any case.
_MORE, _LEAST_HZ = 1.25, 10.0


@dataclass(frozen=True, slots=True)
class Quality:
    """Effects, and the share of the window's first width and height that is drawn."""

    effects: Effects
    scale: float = 1.0


_PLAIN = Effects(fine=False)
RUNGS = (
    Quality(Effects(4)),
    Quality(Effects()),
    Quality(_PLAIN),
    Quality(_PLAIN, 0.8),
    Quality(_PLAIN, 0.64),
)
#: Where a window begins that the processor draws.
SOFTWARE_RUNG = 2


class RenderGovernor:
    """Follows how long pictures take, and says which of `RUNGS` to take.

    Args:
        software: Whether the processor draws.
    """

    def __init__(self, *, software: bool) -> None:
        best = SOFTWARE_RUNG if software else 0
        self._governor = QualityGovernor(len(RUNGS), _HYSTERESIS, way=(best,))
        self._wanted_s = 1.0 / (WANTED_IN_SOFTWARE_HZ if software else WANTED_HZ)
        self.rate_hz = 0.0
        self._slow = 0
        self._spent_s: list[float] = []
        self._since_s: float | None = None

    @property
    def rung(self) -> int:
        """The rung in force, an index of `RUNGS`."""
        return self._governor.level

    def drawn(self, now_s: float, spent_s: float) -> bool:
        """Count a picture that took `spent_s` and was done at `now_s`; return whether there is another rung to take."""
        if self._since_s is None:
            self._since_s = now_s
            self._governor.disturbed(now_s)
            return False
        self._spent_s.append(spent_s)
        elapsed_s = now_s - self._since_s
        if elapsed_s < _JUDGE_S:
            return False
        mean_s = sum(self._spent_s) / len(self._spent_s)
        self.rate_hz = len(self._spent_s) / elapsed_s
        self._spent_s.clear()
        has_changed = self._governor.observe(now_s, self._load(mean_s))
        self._since_s = None if has_changed else now_s
        return has_changed

    def _load(self, mean_s: float) -> Load:
        self._slow = self._slow + 1 if mean_s > self._wanted_s else 0
        if self._slow >= _SLOW_LOOKS:
            self._slow = 0
            return Load.OVER
        return Load.CALM if mean_s * _growth(self.rung) < _ROOM * self._wanted_s else Load.FULL


def _growth(rung: int) -> float:
    """Return how many times longer a picture of the next better rung takes."""
    better, this = RUNGS[max(0, rung - 1)], RUNGS[rung]
    return (better.scale / this.scale) ** 2 if better.effects == this.effects else _MORE_EFFECTS


class Demand:
    """How many pictures a second a window is worth sending: somewhat more than it lately painted."""

    def __init__(self) -> None:
        self._counted: tuple[float, int] | None = None
        self.hz: float | None = None

    def count(self, now_s: float, painted: int) -> float | None:
        """Take how many pictures were painted by `now_s`; return pictures a second, None before that is known."""
        if self._counted is None:
            if painted > 0:  # the first picture is work of another kind
                self._counted = now_s, painted
            return None
        elapsed_s = now_s - self._counted[0]
        if elapsed_s >= _JUDGE_S:
            self.hz = max(_LEAST_HZ, _MORE * (painted - self._counted[1]) / elapsed_s)
            self._counted = now_s, painted
        return self.hz
