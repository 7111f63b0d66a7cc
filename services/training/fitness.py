"""Tells whether the machine is good enough for an attempt that counts, in one sentence with what to do if it is not.

With a force-feedback arm the rig must keep its contracts. Without one nobody feels a late tick: the rig's time is
simulated and loses none, and what is left to ask for is a picture that hands can be steered by.
"""

from __future__ import annotations

from collections import deque

from trocar.protocol import bodies
from trocar.protocol.topics import TICK_S
from trocar.services.runtime.loop.simulated_speed import LEAST_PICTURES_HZ, LEAST_SPEED

_OVER_S = 3.0  # a page counts its pictures once a second, so that three counts are averaged
_STOPPED = "the rig is stopped: press Arm, or ask your instructor"
_LATE = "a part of the rig is late, which a hand would feel: end other programs; `trocar doctor` says more"


class Fitness:
    """Follows the speed of simulated time, the picture at the page, and the supervisor's word.

    Args:
        simulated: Whether the rig's time is simulated.
    """

    def __init__(self, *, simulated: bool = False) -> None:
        self.simulated = simulated
        self._ticks: deque[tuple[float, int]] = deque()
        self._pictures: deque[tuple[float, float]] = deque()
        self._rig = ""

    def take_tick(self, now_s: float, tick: int, pace: float) -> None:
        """Process the rig's newest tick, while its time goes at `pace` by order."""
        if pace != 1.0 or (self._ticks and tick < self._ticks[-1][1]):
            self._ticks.clear()
        self._ticks.append((now_s, tick))
        _forget(self._ticks, now_s)

    def take_pictures(self, now_s: float, pictures_hz: float) -> None:
        """Process the pictures a second that the page with the hands shows; a negative number is unknown."""
        if pictures_hz >= 0.0:
            self._pictures.append((now_s, pictures_hz))
        _forget(self._pictures, now_s)

    def take_rig(self, state: bodies.SupervisorState, spared: frozenset[str]) -> None:
        """Process the supervisor's state; what `spared` processes lack does not matter."""
        is_late = state.state == "degraded" and state.reason.partition(":")[0] not in spared
        stopped = state.safe_stop or state.state == "safe_stop"
        self._rig = _STOPPED if stopped else _LATE if is_late and not self.simulated else ""

    @property
    def speed(self) -> float:
        """Speed of the rig's time against the clock over the last seconds, 1 if unknown."""
        if len(self._ticks) < 2 or self._ticks[-1][0] - self._ticks[0][0] < 0.5 * _OVER_S:
            return 1.0
        (first_s, first), (last_s, last) = self._ticks[0], self._ticks[-1]
        return (last - first) * TICK_S / (last_s - first_s)

    @property
    def practice_only(self) -> str:
        """Why an attempt would not count now, and what to do; empty if it would."""
        return self._rig or self.slow

    @property
    def slow(self) -> str:
        """The same of the machine alone."""
        if not self.simulated:
            return ""
        if self.speed < LEAST_SPEED:
            return f"the simulation runs at {100.0 * self.speed:.0f} % of real time: end other programs on this machine"
        if len(self._pictures) < 2 or self._pictures[-1][0] - self._pictures[0][0] < 0.5 * _OVER_S:
            return ""
        mean_hz = sum(hz for _, hz in self._pictures) / len(self._pictures)
        if mean_hz < LEAST_PICTURES_HZ:
            return (
                f"you see {int(mean_hz)} pictures a second and need {LEAST_PICTURES_HZ:.0f}: "
                "close other tabs and programs, or make this window smaller"
            )
        return ""


def _forget(seen: deque[tuple[float, float]] | deque[tuple[float, int]], now_s: float) -> None:
    while seen and now_s - seen[0][0] > _OVER_S:
        seen.popleft()
