"""Keeps what a loop reserves at what it needs: its work as measured, the decision, the kernel's answer, a sentence."""

from __future__ import annotations

import logging
import os
import time

import numpy as np
from numpy.typing import NDArray

from services.runtime.flight import COLUMNS, ROWS_AT, FlightRing
from services.runtime.loop import LoopMeter
from services.runtime.reservation import Need, Reservation, need_of
from services.runtime.scheduling import PERIOD_NS, Scheduling

#: Oftener in its first seconds, when every loop holds a guess, and while it is short.
_LOOK_EVERY_NS, _LOOK_SOON_NS, _FIRST_LOOKS = 1_000_000_000, 250_000_000, 20
_RAN = COLUMNS.index("ran_ns")
#: The same sentence is said again after so long.
_AGAIN_S = 60.0
#: Fewer periods say nothing of what one in twenty takes.
_LEAST_PERIODS = 50


class ReservationKeeper:
    """Looks now and then at the ring of a loop whose class is SCHED_DEADLINE, or was refused it for want of room."""

    def __init__(self, scheduling: Scheduling, meter: LoopMeter, logger: logging.Logger) -> None:
        self._scheduling, self._meter, self._log = scheduling, meter, logger
        self._reservation = Reservation(scheduling.wish.share if scheduling.reserves else 0.0)
        self._due_ns = time.monotonic_ns() + _LOOK_SOON_NS
        self._looks = 0
        self._said, self._again_s = "", 0.0

    def keep(self) -> bool:
        """Set the reservation to what the work of the last seconds needs, if it is time; return whether it changed."""
        now_ns = time.monotonic_ns()
        if now_ns < self._due_ns:
            return False
        self._looks += 1
        soon = self._reservation.short or self._looks < _FIRST_LOOKS
        self._due_ns = now_ns + (_LOOK_SOON_NS if soon else _LOOK_EVERY_NS)
        periods = max(1, self._meter.periods_allowed)
        work_ns, period_ns = work_per_period(self._meter.flight, periods), periods * self._meter.period_ns
        if len(work_ns) < _LEAST_PERIODS:
            return False
        before = self._scheduling.had
        self._follow(now_ns * 1e-9, need_of(work_ns, max(PERIOD_NS, period_ns)), period_ns)
        return self._scheduling.had != before

    def _follow(self, now_s: float, need: Need, period_ns: int) -> None:
        held = self._reservation
        held.follow(now_s, need, lambda share: self._scheduling.reserve(share, period_ns))
        if held.gives_up(now_s, need):
            self._scheduling.step_down()
        if held.short:
            self._tell(now_s, need)

    def _tell(self, now_s: float, need: Need) -> None:
        """Say what does not fit, once for each class, and again after a while."""
        had = self._scheduling.had
        if had.split()[0] != self._said or now_s >= self._again_s:
            self._log.warning("scheduling: %s", shortage(need, had))
            self._said, self._again_s = had.split()[0], now_s + _AGAIN_S


def shortage(need: Need, had: str) -> str:
    """Return what does not fit, what is had instead, and what to do about it."""
    return (
        f"no room for {100 * need.share:.0f} % of a core beside what others reserve on {os.cpu_count()} cores: "
        f"has {had}; give the rig more cores, or choose a lower rung of the scene's quality"
    )


def work_per_period(ring: FlightRing, ticks: int) -> NDArray[np.int64]:
    """Return the processor time of the ring's periods of so many ticks, in ns."""
    rows = np.frombuffer(ring.memory, np.int64, offset=ROWS_AT).reshape(ring.capacity, -1)
    kept = rows[: min(ring.written, ring.capacity), _RAN]
    whole: NDArray[np.int64] = kept[: len(kept) // ticks * ticks].reshape(-1, ticks).sum(axis=1)
    return whole
