"""Chooses a window's quality: effects, then pixels, are reduced until the picture rate is sufficient. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from trocar.services.runtime.loop.quality_governor import Hysteresis, Load, QualityGovernor
from trocar.services.visualization.render import Effects

#: Picture rates below which quality is reduced: with a graphics processor, and in software.
WANTED_HZ, WANTED_IN_SOFTWARE_HZ = 24.0, 12.0
_JUDGE_S = 1.0  # twelve pictures at least, so that one more or less is no tenth
_SLOW_LOOKS = 2  # in a row, as one slow second is chance
#: Fraction of a picture's available time that the predicted time at a better level may take, and the assumed ratio of
#: times for more effects; otherwise it is the ratio of pixels.
_ROOM, _MORE_EFFECTS = 0.9, 2.0
#: A try of a better level has failed if the next change is for the worse.
_HYSTERESIS = Hysteresis(calm_s=10.0, trial_s=math.inf)
#: Factor of the requested rate over the painted one, which lets a faster window show it, and the least request.
_MORE, _LEAST_HZ = 1.25, 10.0


@dataclass(frozen=True, slots=True)
class Quality:
    """Effects, and the fraction of the window's initial width and height that is drawn."""

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
#: Initial level of software rendering: the first without fine effects.
SOFTWARE_RUNG = 2


class RenderGovernor:
    """Chooses one of `RUNGS` from the times of pictures.

    Args:
        software: Whether rendering is in software.
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
        """The present level, an index of `RUNGS`."""
        return self._governor.level

    def drawn(self, now_s: float, spent_s: float) -> bool:
        """Count a picture that took `spent_s` and was done at `now_s`; return whether the level has changed."""
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
    """Return the predicted ratio of a picture's time at the next better level."""
    better, this = RUNGS[max(0, rung - 1)], RUNGS[rung]
    return (better.scale / this.scale) ** 2 if better.effects == this.effects else _MORE_EFFECTS


class Demand:
    """Rate of pictures to send to a window: somewhat more than it recently painted."""

    def __init__(self) -> None:
        self._counted: tuple[float, int] | None = None
        self.hz: float | None = None

    def count(self, now_s: float, painted: int) -> float | None:
        """Process the number of pictures painted by `now_s`; return the rate to send, None while unknown."""
        if self._counted is None:
            if painted > 0:  # the first picture takes longer
                self._counted = now_s, painted
            return None
        elapsed_s = now_s - self._counted[0]
        if elapsed_s >= _JUDGE_S:
            self.hz = max(_LEAST_HZ, _MORE * (painted - self._counted[1]) / elapsed_s)
            self._counted = now_s, painted
        return self.hz
