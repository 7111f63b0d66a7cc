"""Reopening an arm while the gateway runs: all forces end, then a thread stops and restarts the scheduler."""

from __future__ import annotations

from collections.abc import Callable

from trocar.services.gateway.devices.background_open import BackgroundOpen
from trocar.services.gateway.devices.clock import Clock
from trocar.services.gateway.hdapi.cells import ArmCell, ServoCell
from trocar.services.gateway.hdapi.open_arm import OpenArm

#: Time for all forces to fall to zero at the rig's rate limit, and time after which the library is taken to hang.
_LET_GO_NS, _PATIENCE_NS = 200_000_000, 20_000_000_000


class Reopening:
    """Reopening of one arm, started by construction. It does not block: call `go_on` until it has ended.

    Args:
        servo, cells: State of the scheduler, None if it does not run, and all its arms.
        open_it: Stops the scheduler, opens the arm, and restarts the scheduler with all other arms in any case.
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
        """Advance as far as possible without waiting."""
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
        """Whether the scheduler is silent because of this reopening."""
        return not self.ended and self._lasts_ns() < _PATIENCE_NS

    def take(self) -> tuple[OpenArm | None, str]:
        """Return the arm, or the reason of the failure, after the end."""
        return self._arm, self._problem

    def give_up(self) -> None:
        """Cancel it before its thread has started, or wait for its end."""
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
