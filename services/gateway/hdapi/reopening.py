"""Opening an arm anew while the gateway goes on: every hand is let go, then a thread stops and starts the scheduler."""

from __future__ import annotations

from collections.abc import Callable

from services.gateway.background_open import BackgroundOpen
from services.gateway.clock import Clock
from services.gateway.hdapi.cells import ArmCell, ServoCell
from services.gateway.hdapi.open_arm import OpenArm

#: Hands are let go within so long, at the rig's rate limit; a library that takes longer than this hangs.
_LET_GO_NS, _PATIENCE_NS = 200_000_000, 20_000_000_000


class Reopening:
    """Of one arm, begun by being made. Nobody waits: `go_on` is called until it has ended.

    Args:
        servo, cells: What the scheduler works on, None where it does not run, and all its arms.
        open_it: Stops the scheduler, opens the arm, starts the scheduler, with all other arms in any case.
    """

    def __init__(
        self, servo: ServoCell | None, cells: list[ArmCell], open_it: Callable[[], OpenArm], clock: Clock
    ) -> None:
        self._servo, self._cells, self._open_it, self._clock = servo, cells, open_it, clock
        self._began_ns = clock.monotonic_ns()
        self._opening: BackgroundOpen[OpenArm] | None = None
        self._arm: OpenArm | None = None
        self._problem = ""
        self.ended = False
        if servo is not None:
            servo.pausing = True

    def go_on(self) -> None:
        """Do what can be done without waiting."""
        if self.ended:
            return
        if self._opening is not None:
            if self._opening.done:
                self._end(*self._opening.take())
        elif not any(cell.motors_on for cell in self._cells):
            self._opening = BackgroundOpen(self._open_it)
        elif self._lasts_ns() > _LET_GO_NS:
            self._end(None, "the scheduler of OpenHaptics does not run")

    @property
    def is_pause(self) -> bool:
        """Whether it is the reason that the scheduler does not call."""
        return not self.ended and self._lasts_ns() < _PATIENCE_NS

    def take(self) -> tuple[OpenArm | None, str]:
        """Return the arm, or why there is none; after it has ended."""
        return self._arm, self._problem

    def give_up(self) -> None:
        """End before it has begun, or wait for its end."""
        if self._opening is not None:
            self._end(*self._opening.take())
        elif not self.ended:
            self._end(None, "it was given up")

    def _lasts_ns(self) -> int:
        return self._clock.monotonic_ns() - self._began_ns

    def _end(self, arm: OpenArm | None, problem: str) -> None:
        self.ended = True
        self._arm, self._problem = arm, problem
        if self._servo is not None:
            self._servo.pausing = False
