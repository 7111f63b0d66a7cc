"""Speed of simulated time: where a hand would see too few pictures to steer by, time slows instead.

The loops come before the browser on a core, so they leave a browser that draws on the processor what they do not take.
At a lower speed they take less in the same proportion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from trocar.services.runtime.loop.quality_governor import Hysteresis, Load, QualityGovernor

#: Pictures a second that a person needs to steer by, and the slowest simulated time that is not slow motion.
LEAST_PICTURES_HZ, LEAST_SPEED = 12.0, 0.5
#: Speeds, fastest first. The last keeps a distance to the least, as late ticks slow the time, too. The steps are small,
#: so that trying a faster one in vain costs a picture or two, not the attempt.
SPEEDS = (1.0, 0.9, 0.8, 0.7, 0.6)
#: A page counts the pictures of a second, so its count is uncertain by one.
_COUNT_HZ = 1.0
_NEEDED_HZ = LEAST_PICTURES_HZ + _COUNT_HZ
#: So many that the loops take nothing from them, as a graphics processor draws: enough at full speed, too, for which
#: the slowest leaves up to 1.7 times as many.
_AMPLE_HZ = 2.0 * _NEEDED_HZ
_HYSTERESIS = Hysteresis(calm_s=10.0, trial_s=20.0, longest_s=120.0)
#: A page counts its pictures once a second and says the count more often; after some seconds without a word nobody
#: steers.
_COUNTED_S, _SILENT_S = 1.0, 3.0


class SpeedGovernor:
    """Keeps the speed at which the page that has the hands shows enough pictures.

    It begins with the slowest and goes faster where there is room, so that the first seconds of an attempt are seen,
    too. A scene at rest costs less than one that is played: what a page shows of it says nothing of room. Without a
    page the speed is that of the clock; what it has learned of a page stays for the next.

    Args:
        speeds: The speeds to choose from, fastest first.
    """

    def __init__(self, speeds: Sequence[float] = SPEEDS) -> None:
        self._speeds = speeds
        self._ladder = QualityGovernor(len(speeds), _HYSTERESIS, range(len(speeds)))
        self._told_s = self._counted_s = -math.inf
        self._is_silent = True

    @property
    def speed(self) -> float:
        """Speed of simulated time, 0 to 1."""
        return 1.0 if self._is_silent else self._speeds[self._ladder.level]

    def take_pictures(self, now_s: float, pictures_hz: float, *, is_played: bool) -> None:
        """Process what the page told at `now_s`; a negative number is unknown. `is_played`: whether an attempt runs."""
        if pictures_hz < 0.0:
            return
        self._told_s, self._is_silent = now_s, False
        if now_s - self._counted_s < _COUNTED_S:
            return
        self._counted_s = now_s
        if pictures_hz < _NEEDED_HZ:
            self._ladder.overdrawn(now_s)
            if self._ladder.can_lower:
                self._ladder.descend(*self._levels_down(pictures_hz))
        elif pictures_hz >= _AMPLE_HZ:
            while self._ladder.come_back(now_s):
                pass
        else:
            self._ladder.observe(now_s, Load.CALM if is_played and self._has_room(pictures_hz) else Load.FULL)

    def _has_room(self, pictures_hz: float) -> bool:
        """Return whether the next speed would leave enough pictures, if they become fewer as the speed grows."""
        faster = self._speeds[max(self._ladder.level - 1, 0)]
        return pictures_hz * self.speed / faster >= _NEEDED_HZ + _COUNT_HZ

    def _levels_down(self, pictures_hz: float) -> list[int]:
        """Return the levels down to the speed that is too fast by no more than the pictures are too few."""
        wanted = self.speed * pictures_hz / _NEEDED_HZ
        level = next((k for k, speed in enumerate(self._speeds) if speed <= wanted), len(self._speeds) - 1)
        return list(range(self._ladder.level + 1, level + 1))

    def forget_silent_page(self, now_s: float) -> None:
        """Return to the speed of the clock once no page tells of pictures any more."""
        self._is_silent = now_s - self._told_s > _SILENT_S
