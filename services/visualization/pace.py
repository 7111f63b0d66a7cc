"""What a window's picture is worth: effects, then pixels, are given up until there are enough. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from services.visualization.render import Effects

#: Pictures a second below which something is given up: with a graphics processor, and in software.
WANTED_HZ, WANTED_IN_SOFTWARE_HZ = 24.0, 15.0
_JUDGE_S = 1.0
#: With so much time to spare for so long something is taken back; twice as long after each time that it was too much.
_SPARE, _CALM_S = 0.45, 10.0


#: Asked for beyond what was painted, so that a window that can paint more shows it; and in any case.
_MORE, _LEAST_HZ = 1.25, 10.0


@dataclass(frozen=True, slots=True)
class Rung:
    """Effects, and the share of the window's first width and height that is drawn."""

    effects: Effects
    scale: float = 1.0


_PLAIN = Effects(0, per_pixel=False, fine=False)
RUNGS = (
    Rung(Effects(4)),
    Rung(Effects(0)),
    Rung(_PLAIN),
    Rung(_PLAIN, 0.8),
    Rung(_PLAIN, 0.64),
)
#: Where a window begins that the processor draws.
SOFTWARE_RUNG = 2


class Pace:
    """Follows how long pictures take, and says which rung to take.

    Parameters
    ----------
    software
        Whether the processor draws.
    """

    def __init__(self, *, software: bool) -> None:
        self._best = SOFTWARE_RUNG if software else 0
        self._wanted_s = 1.0 / (WANTED_IN_SOFTWARE_HZ if software else WANTED_HZ)
        self.rung = self._best
        self.rate_hz = 0.0
        self._spent_s: list[float] = []
        self._since_s: float | None = None
        self._calm_since_s = 0.0
        self._calm_s = _CALM_S
        self._raised = False

    def drawn(self, now_s: float, spent_s: float) -> bool:
        """Count a picture that took `spent_s` and was done at `now_s`; return whether there is another rung to take."""
        if self._since_s is None:
            self._since_s = self._calm_since_s = now_s
            return False
        self._spent_s.append(spent_s)
        elapsed_s = now_s - self._since_s
        if elapsed_s < _JUDGE_S:
            return False
        mean_s = sum(self._spent_s) / len(self._spent_s)
        self.rate_hz = len(self._spent_s) / elapsed_s
        self._spent_s.clear()
        self._since_s = now_s
        return self._judge(now_s, mean_s)

    def _judge(self, now_s: float, mean_s: float) -> bool:
        if mean_s > _SPARE * self._wanted_s:
            self._calm_since_s = now_s
        if mean_s > self._wanted_s and self.rung < len(RUNGS) - 1:
            self._calm_s *= 2.0 if self._raised else 1.0
            self._raised = False
            return self._take(now_s, self.rung + 1)
        if now_s - self._calm_since_s >= self._calm_s and self.rung > self._best:
            self._raised = True
            return self._take(now_s, self.rung - 1)
        return False

    def _take(self, now_s: float, rung: int) -> bool:
        self.rung, self._calm_since_s, self._since_s = rung, now_s, None
        return True


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
