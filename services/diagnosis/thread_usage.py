"""The kernel's counts of the rig's threads: wake-ups, context switches, time on a processor and waiting for one."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from trocar.services.runtime.measures.flights import ThreadTime

_PERIOD_S = 1.0  # as rates are told by the second
_GONE = (FileNotFoundError, ProcessLookupError, PermissionError, ValueError, IndexError)


class Counts(NamedTuple):
    """Counts of one thread since it began; `woken` are its wake-ups, equal to its voluntary context switches."""

    process: str
    thread: str
    woken: int
    preempted: int
    ran_ns: int
    waited_ns: int

    def since(self, older: Counts) -> Counts:
        """Return the difference from `older`."""
        return Counts(self.process, self.thread, *(b - a for a, b in zip(older[2:], self[2:], strict=True)))


@dataclass(frozen=True, slots=True)
class Usage:
    """Rates of one process with its children, measured over `seconds`."""

    wakeups_per_s: float
    switches_per_s: float
    processor_share: float
    waited_share: float
    seconds: float


class UsageRow(NamedTuple):
    """Counts of a process since it began, and its recent rates, None before they are known."""

    since_start: Counts
    lately: Usage | None


class _Sample(NamedTuple):
    at_s: float
    threads: Mapping[int, Counts]


class ThreadUsage:
    """Samples the threads of the rig's processes once a second, except in other containers."""

    def __init__(self) -> None:
        self._samples: deque[_Sample] = deque(maxlen=3)

    def sample(self, now_s: float, pids: Mapping[str, int]) -> None:
        """Sample the processes with these ids, 0 for none, if due."""
        if self._samples and now_s - self._samples[-1].at_s < _PERIOD_S:
            return
        known = set(pids.values())
        found = {tid: counts for name, pid in pids.items() if pid for tid, counts in threads_of(name, pid, known)}
        self._samples.append(_Sample(now_s, found))

    def report(self) -> dict[str, UsageRow]:
        """Return the counts of the living threads of each process, and rates between the last two samples."""
        totals = _by_process(self._samples[-1].threads.values()) if self._samples else {}
        rates: dict[str, Usage] = {}
        if len(self._samples) >= 2:
            s, counted = self._since(-2)
            rates = {
                name: Usage(c.woken / s, (c.woken + c.preempted) / s, 1e-9 * c.ran_ns / s, 1e-9 * c.waited_ns / s, s)
                for name, c in _by_process(counted).items()
            }
        return {name: UsageRow(total, rates.get(name)) for name, total in totals.items()}

    def busiest(self) -> tuple[ThreadTime, ...]:
        """Return the threads that ran and waited between the first and the last stored sample, busiest first."""
        if len(self._samples) < 2:
            return ()
        s, counted = self._since(0)
        times = (
            ThreadTime(c.process, c.thread, s, 1e-9 * c.ran_ns, 1e-9 * c.waited_ns, c.woken + c.preempted)
            for c in counted
        )
        return tuple(sorted(times, key=lambda each: -each.ran_s))

    def _since(self, index: int) -> tuple[float, list[Counts]]:
        """Return the seconds since a stored sample, and the counts of each living thread in them."""
        older, newer = self._samples[index], self._samples[-1]
        both = newer.threads.keys() & older.threads.keys()
        return newer.at_s - older.at_s, [newer.threads[tid].since(older.threads[tid]) for tid in both]


def _by_process(counts: Iterable[Counts]) -> dict[str, Counts]:
    sums: dict[str, Counts] = {}
    for c in counts:
        so_far = sums.get(c.process, Counts(c.process, "", 0, 0, 0, 0))
        sums[c.process] = Counts(c.process, "", *(a + b for a, b in zip(so_far[2:], c[2:], strict=True)))
    return sums


def threads_of(name: str, pid: int, known: Collection[int]) -> Iterator[tuple[int, Counts]]:
    """Yield the threads of a process and of its children without a name of their own."""
    try:
        tasks = list(Path(f"/proc/{pid}/task").iterdir())
    except _GONE:
        return
    for task in tasks:
        try:
            yield int(task.name), _counts(name, task)
            children = (task / "children").read_text().split()
        except _GONE:
            continue
        for child in map(int, children):
            if child not in known:
                yield from threads_of(name, child, known)


def _counts(name: str, task: Path) -> Counts:
    status = dict(line.split(":", 1) for line in (task / "status").read_text().splitlines() if ":" in line)
    ran, waited = (task / "schedstat").read_text().split()[:2]
    woken, preempted = status["voluntary_ctxt_switches"], status["nonvoluntary_ctxt_switches"]
    return Counts(name, status["Name"].strip(), int(woken), int(preempted), int(ran), int(waited))
