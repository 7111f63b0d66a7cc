"""When in a millisecond no loop works on a core: the moment at which a core sleeper disturbs nothing.

All loops keep to the grid of the gateway, so of each millisecond the same parts are busy. A Python thread that wakes
above all others takes 75 us of its core. Amid a tick that cost haptics 80 us and physics 120, in every tenth tick, for
as long as the rig ran, or nothing, depending on where the sleeper's own grid happened to start.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from services.runtime.flights import Flight
from services.supervisor.observers.core_sleepers import PERIOD_NS

#: The grid of the loops is cut into slots.
SLOT_NS = 20_000
_SLOTS = PERIOD_NS // SLOT_NS
#: Before a tick is due its loop may be at what is in no tick, and must be let alone: the gateway serves its handles.
LEAD_NS = 300_000
#: For how long a look takes the core, with what comes of it; and how far round it quiet is still preferred, a little.
_LOOK_SLOTS, _ROUND_SLOTS, _LITTLE = 6, 6, 0.01
_FAST_HZ = 1e9 / PERIOD_NS


def idle_phase_ns(flights: Iterable[Flight], core: int) -> int | None:
    """Return the time of the monotonic clock within a millisecond at which loops on `core` are the least often busy.

    None if no loop of 1 kHz has that core for itself.
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
    """Return the share of ticks in which each slot is taken, (slots,); a tick over a millisecond takes them all."""
    first = (flight.column("due_ns") - LEAD_NS) // SLOT_NS
    last = np.minimum(flight.column("ended_ns") // SLOT_NS, first + _SLOTS - 1)
    taken = np.bincount(first % _SLOTS, minlength=_SLOTS) - np.bincount((last + 1) % _SLOTS, minlength=_SLOTS)
    over_the_end = np.count_nonzero((last + 1) // _SLOTS > first // _SLOTS)
    found: NDArray[np.float64] = (np.cumsum(taken) + over_the_end) / len(first)
    return found
