"""Adapts a loop's reservation to its measured work, reports shortages, and keeps to the pauses of its rig."""

from __future__ import annotations

import logging
import os
import struct
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trocar.services.runtime.loop.loop import CATCH_UP, LoopMeter
from trocar.services.runtime.measures.flight import COLUMNS, ROWS_AT, FlightRing
from trocar.services.runtime.private_directory import open_private
from trocar.services.runtime.realtime.reservation import LONGEST_PAUSE_S, Reservation, need_of, pause_s
from trocar.services.runtime.realtime.scheduling import PERIOD_NS, Scheduling

#: Periods of the adaptation, normally, and in the first seconds or while it is short; and the number of the first ones.
_LOOK_EVERY_NS, _LOOK_SOON_NS, _FIRST_LOOKS = 1_000_000_000, 250_000_000, 20
_TICK, _RAN = COLUMNS.index("tick"), COLUMNS.index("ran_ns")
#: Time after which the message is repeated.
_AGAIN_S = 60.0
#: Fewest periods for an estimate of the quantile.
_LEAST_PERIODS = 50
#: Distance of the priorities of a rig's loops: so much more gives way each time.
TIER = 10
#: File of a rig's pause, beside its flight rings: its end and length in s, by the monotonic clock, and the priority.
PAUSE_FILE = "reservations.pause"
_PAUSE = struct.Struct("<3d")


class ReservationPause:
    """The time for which loops of a rig below a priority reserve nothing, shared by its processes.

    Raises BusError or OSError if the file cannot be created.
    """

    def __init__(self, directory: Path) -> None:
        self._file = open_private(directory / PAUSE_FILE, os.O_RDWR | os.O_CREAT)

    def below(self, now_s: float) -> int:
        """Return the priority below which loops reserve nothing now, 0 for none.

        The end of a pause from before the machine's start does not count.
        """
        until_s, _, below = self._read()
        return int(below) if now_s < until_s <= now_s + LONGEST_PAUSE_S else 0

    def begin(self, below: int, now_s: float) -> None:
        """Begin a pause of the loops below a priority, or include more of them in the present one."""
        until_s, length_s, _ = self._read()
        if not self.below(now_s):
            length_s = pause_s(now_s, until_s, length_s)
        os.pwrite(self._file, _PAUSE.pack(now_s + length_s, length_s, below), 0)

    def _read(self) -> tuple[float, float, float]:
        data = os.pread(self._file, _PAUSE.size, 0)
        until_s, length_s, below = _PAUSE.unpack(data) if len(data) == _PAUSE.size else (0.0, 0.0, 0.0)
        return until_s, length_s, below


class ReservationKeeper:
    """Adapts the reservation of a loop that has SCHED_DEADLINE, or was refused it for lack of room."""

    def __init__(
        self, scheduling: Scheduling, meter: LoopMeter, pause: ReservationPause, logger: logging.Logger
    ) -> None:
        self._scheduling, self._meter, self._pause, self._log = scheduling, meter, pause, logger
        self._reservation = Reservation(scheduling.requested.share if scheduling.reserves else 0.0)
        self._due_ns = time.monotonic_ns() + _LOOK_SOON_NS
        self._looks = 0
        self._again_s = 0.0

    def keep(self) -> bool:
        """Set the reservation by the work of the last seconds, if due; return whether it changed."""
        now_ns = time.monotonic_ns()
        if now_ns < self._due_ns:
            return False
        self._looks += 1
        soon = self._reservation.short or self._looks < _FIRST_LOOKS
        self._due_ns = now_ns + (_LOOK_SOON_NS if soon else _LOOK_EVERY_NS)
        periods = max(1, self._meter.periods_allowed)
        work_ns = work_per_period(self._meter.flight, periods, catches_up=self._meter.catches_up)
        period_ns = periods * self._meter.period_ns
        if len(work_ns) < _LEAST_PERIODS:
            return False
        before = self._scheduling.had
        self._follow(now_ns * 1e-9, need_of(work_ns, max(PERIOD_NS, period_ns)), period_ns)
        return self._scheduling.had != before

    def _follow(self, now_s: float, need: float, period_ns: int) -> None:
        held, pause, priority = self._reservation, self._pause, self._scheduling.requested.priority
        if priority >= pause.below(now_s):
            held.follow(now_s, need, lambda share: self._scheduling.reserve(share, period_ns))
            if held.is_left_out(now_s):
                held.wait_again(now_s)
                pause.begin(min(max(pause.below(now_s), priority - 2 * TIER) + TIER, priority + 1), now_s)
                self._tell(now_s, need)
        if priority < pause.below(now_s):
            if self._scheduling.reserves:
                self._scheduling.step_down()
            held.drop()

    def _tell(self, now_s: float, need: float) -> None:
        """Report a shortage, and again after a while."""
        if now_s >= self._again_s:
            self._log.warning("scheduling: %s", shortage(need))
            self._again_s = now_s + _AGAIN_S


def shortage(need: float) -> str:
    """Return a message on a shortage, its effect, and the remedy."""
    return (
        f"no room for {100 * need:.0f} % of a core beside what others reserve on {os.cpu_count()} cores: for now "
        "loops of lower priority, or this one, reserve none; give the rig more cores, or choose a lower rung of the "
        "scene's quality"
    )


def work_per_period(ring: FlightRing, ticks: int, *, catches_up: bool = False) -> NDArray[np.float64]:
    """Return the processor times of the ring's periods of `ticks` ticks, in ns.

    A tick of a loop that catches up does the work of all ticks since the last one, if they are few enough (`CATCH_UP`).
    Counted as the work of one, it would make a late loop ask for more the later it is.
    """
    rows = np.frombuffer(ring.memory, np.int64, offset=ROWS_AT).reshape(ring.capacity, -1)
    order = np.arange(max(0, ring.written - ring.capacity), ring.written) % ring.capacity
    tick, ran_ns = rows[order, _TICK], rows[order, _RAN]
    covered = np.ones(len(tick), np.int64)
    if catches_up:
        jump = np.diff(tick)
        covered[1:] = np.where((jump > 0) & (jump <= CATCH_UP * ticks), jump, 1)
    period = (np.cumsum(covered) - covered) // ticks
    ticks_of, work_of = np.bincount(period, covered), np.bincount(period, ran_ns)
    whole = ticks_of >= ticks
    found: NDArray[np.float64] = work_of[whole] * ticks / ticks_of[whole]
    return found
