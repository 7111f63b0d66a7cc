"""Phase within a millisecond at which no loop works on a core, so that a core sleeper disturbs nothing.

All loops keep to the grid of the gateway, so the same parts of each millisecond are busy. A Python thread that wakes
above all others takes 75 us of its core. In the middle of a tick that delayed haptics by 80 us and physics by 120 in
every tenth tick, or not at all, depending on the start of the sleeper's own grid.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from trocar.services.runtime.measures.flights import Flight
from trocar.services.supervisor.diagnosis.core_sleepers import PERIOD_NS

#: Length of the slots that the loops' grid is divided into.
SLOT_NS = 20_000
_SLOTS = PERIOD_NS // SLOT_NS
#: Time before a tick is due that is left free, because the gateway then serves its handles.
LEAD_NS = 300_000
#: Slots taken by a wake-up with its effects; slots around it that are preferably idle, too; and their weight.
_LOOK_SLOTS, _ROUND_SLOTS, _LITTLE = 6, 6, 0.01
_FAST_HZ = 1e9 / PERIOD_NS


def idle_phase_ns(flights: Iterable[Flight], core: int) -> int | None:
    """Return the phase of the monotonic clock, in ns of a millisecond, at which loops on `core` are least often busy.

    Return None if no 1 kHz loop is pinned to that core.
    """
    busy = np.zeros(_SLOTS)
    there = [f for f in flights if f.cores == (core,) and f.rate_hz == _FAST_HZ and len(f.rows)]
    for flight in there:
        busy += _busy(flight)
    if not there:
        return None
    cost = np.zeros(_SLOTS)
    for k in range(-_ROUND_SLOTS, _LOOK_SLOTS + _ROUND_SLOTS):
        cost += np.roll(busy, -k) * (1.0 if 0 <= k < _LOOK_SLOTS else _LITTLE)
    return int(np.argmin(cost)) * SLOT_NS


def _busy(flight: Flight) -> NDArray[np.float64]:
    """Return the share of ticks in which each slot is busy, (slots,); a tick over a millisecond occupies all."""
    first = (flight.column("due_ns") - LEAD_NS) // SLOT_NS
    last = np.minimum(flight.column("ended_ns") // SLOT_NS, first + _SLOTS - 1)
    taken = np.bincount(first % _SLOTS, minlength=_SLOTS) - np.bincount((last + 1) % _SLOTS, minlength=_SLOTS)
    over_the_end = np.count_nonzero((last + 1) // _SLOTS > first // _SLOTS)
    found: NDArray[np.float64] = (np.cumsum(taken) + over_the_end) / len(first)
    return found
