"""What made ticks late: the worst of them, what else was on their core meanwhile, and what the machine did."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trocar.services.diagnosis.core_sleepers import NAME as FLOOR
from trocar.services.runtime.measures.flight import COLUMNS
from trocar.services.runtime.measures.flights import FAST_HZ, Flight, ThreadTime, overrun_ns

#: Later than this the machine did not wake who was due: ten times what a wake-up takes.
FLOOR_LATE_NS = 300_000
#: Why a tick was late: nobody was woken on its core; it was working; or none of what is known (its frame was on its
#: way, a bus thread ran, or a process that is no loop of the rig). The name of another loop: that had the core.
#: Of a process that the kernel says waited for a core in that time, this is what is not known otherwise.
MACHINE, OWN, UNKNOWN, WAITED = "the machine", "its own work", "unknown", "no core"
#: A process waits in earnest that waited for so much of the time.
_WAITS = 0.25
#: Ticks that are closer together than this belong to one incident.
_APART_NS = 2_000_000


@dataclass(frozen=True, slots=True)
class BadTick:
    """A tick that ended after its deadline. Times in ns; `why` is the largest part of what it was late by, in words."""

    process: str
    cores: tuple[int, ...]
    tick: int
    due_ns: int
    began_ns: int
    ended_ns: int
    over_ns: float
    over_periods: float
    on_core_ns: int
    longest_stage: str
    longest_stage_ns: int
    why: str


def is_floor(flight: Flight) -> bool:
    """Return whether a flight is of the machine's watchers."""
    return flight.name.removeprefix(FLOOR).isdigit()


def worst_ticks(flights: Sequence[Flight], count: int, threads: Sequence[ThreadTime] = ()) -> list[BadTick]:
    """Return the `count` ticks that were late by most periods of their loop, in the order of time.

    Of loops that the hand does not feel a quarter at most, while there are others: a picture or a recorder that is held
    up for half a second again and again, as ordinary processes are, would leave room for nothing else.
    """
    loops = [flight for flight in flights if not is_floor(flight)]
    found = [(float(over), flight, row) for flight in loops for over, row in _overdue(flight)]
    found.sort(key=lambda each: -each[0])
    slow = [each for each in found if each[1].rate_hz < FAST_HZ]
    fast = [each for each in found if each[1].rate_hz >= FAST_HZ]
    slow = slow[: max(count // 4, count - len(fast))]
    waiting = {each.process for each in threads if each.waited_s >= _WAITS * each.seconds}
    bad = [
        _bad_tick(flight, row, flights, flight.name in waiting)
        for _, flight, row in [*fast[: count - len(slow)], *slow]
    ]
    return sorted(bad, key=lambda tick: tick.due_ns)


def _overdue(flight: Flight) -> Iterator[tuple[float, int]]:
    over = overrun_ns(flight) / flight.period_ns
    return ((float(over[row]), int(row)) for row in np.flatnonzero(over > 0.0))


def _bad_tick(flight: Flight, row: int, flights: Sequence[Flight], waits: bool) -> BadTick:
    tick, due, began, ended, ran = (int(value) for value in flight.rows[row, : len(COLUMNS)])
    stages = flight.rows[row, len(COLUMNS) :]
    longest = int(stages.argmax()) if len(stages) else -1
    over_ns = ended - due - flight.period_ns
    return BadTick(
        process=flight.name,
        cores=flight.cores,
        tick=tick,
        due_ns=due,
        began_ns=began,
        ended_ns=ended,
        over_ns=over_ns,
        over_periods=over_ns / flight.period_ns,
        on_core_ns=min(ran, ended - began),
        longest_stage=flight.stages[longest] if longest >= 0 and stages[longest] > 0 else "",
        longest_stage_ns=int(stages[longest]) if longest >= 0 else 0,
        why=_why(flight, (due, began, ended, ran), flights, WAITED if waits else UNKNOWN),
    )


def _why(flight: Flight, times_ns: tuple[int, int, int, int], flights: Sequence[Flight], else_: str) -> str:
    """Return the largest of: the machine did not wake anybody; others had the core; own work; `else_`."""
    due, began, ended, ran = times_ns
    machine_ns = max((_machine_ns(f, due, ended) for f in flights if is_floor(f) and shares_core(f, flight)), default=0)
    if machine_ns > FLOOR_LATE_NS:
        return f"{MACHINE} {_ms(machine_ns)}"
    neighbours = [f for f in flights if f is not flight and not is_floor(f) and shares_core(f, flight)]
    others = {f.name: _busy_ns(f, due, ended) for f in neighbours}
    own_ns = min(ran, ended - began)
    other, other_ns = max(others.items(), key=lambda each: each[1], default=("", 0))
    unknown_ns = max(0, ended - due - own_ns - sum(others.values()))
    if own_ns >= max(other_ns, unknown_ns):
        return f"{OWN} {_ms(own_ns)}"
    return f"{other} {_ms(other_ns)}" if other_ns >= unknown_ns else f"{else_} {_ms(unknown_ns)}"


def shares_core(one: Flight, other: Flight) -> bool:
    """Return whether two loops are pinned to the same core; one that may run anywhere shares none for certain."""
    return len(one.cores) == 1 and one.cores == other.cores


def woken_ns(floor: Flight) -> NDArray[np.int64]:
    """Return when the machine woke a watcher, (n,): while that was runnable and waited, somebody else had the core.

    Files of older versions tell that waiting as the time that it ran.
    """
    woken: NDArray[np.int64] = np.maximum(floor.column("due_ns"), floor.column("began_ns") - floor.column("ran_ns"))
    return woken


def _machine_ns(floor: Flight, from_ns: int, to_ns: int) -> int:
    due, woke = floor.column("due_ns"), woken_ns(floor)
    inside = (due < to_ns) & (woke > from_ns)
    return int((woke - due)[inside].max(initial=0))


def _busy_ns(flight: Flight, from_ns: int, to_ns: int) -> int:
    """Return for how long a loop was in its ticks between two times."""
    began, ended = np.maximum(flight.column("began_ns"), from_ns), np.minimum(flight.column("ended_ns"), to_ns)
    return int(np.maximum(0, ended - began).sum())


def incidents(ticks: Sequence[BadTick]) -> list[list[BadTick]]:
    """Return ticks, given in the order of time, in groups of those that happened together."""
    groups: list[list[BadTick]] = []
    until_ns = 0
    for tick in ticks:
        if not groups or tick.due_ns > until_ns + _APART_NS:
            groups.append([])
        groups[-1].append(tick)
        until_ns = max(until_ns, tick.ended_ns)
    return groups


def _ms(duration_ns: float) -> str:
    return f"{duration_ns / 1e6:.2f} ms"
