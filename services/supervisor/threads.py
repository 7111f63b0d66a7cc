"""What the kernel counts of the rig's threads: wake-ups, context switches, time on a processor and waiting for one."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from services.runtime.flights import ThreadTime

_PERIOD_S = 1.0
_GONE = (FileNotFoundError, ProcessLookupError, PermissionError, ValueError, IndexError)


@dataclass(frozen=True, slots=True)
class Counts:
    """Of one thread since it began. A thread that gave up its processor was woken again: `woken` are its wake-ups."""

    process: str
    thread: str
    woken: int
    preempted: int
    ran_ns: int
    waited_ns: int


@dataclass(frozen=True, slots=True)
class Usage:
    """Of one process, with all that it has started, a second; `seconds` is what it was counted over."""

    wakeups_per_s: float
    switches_per_s: float
    processor_share: float
    waited_share: float
    seconds: float


@dataclass(frozen=True, slots=True)
class _Sample:
    at_s: float
    threads: Mapping[int, Counts]


class ThreadWatch:
    """Looks at the threads of the rig's processes once a second; of processes of another container it sees none."""

    def __init__(self) -> None:
        self._samples: deque[_Sample] = deque(maxlen=3)

    def turn(self, now_s: float, pids: Mapping[str, int]) -> None:
        """Look, if it is time to."""
        if self._samples and now_s - self._samples[-1].at_s < _PERIOD_S:
            return
        known = set(pids.values())
        found = {tid: counts for name, pid in pids.items() if pid for tid, counts in threads_of(name, pid, known)}
        self._samples.append(_Sample(now_s, found))

    def totals(self) -> dict[str, Counts]:
        """Return what the threads of each process that live now have counted."""
        sums: dict[str, Counts] = {}
        for c in self._samples[-1].threads.values() if self._samples else ():
            so_far = sums.get(c.process, Counts(c.process, "", 0, 0, 0, 0))
            sums[c.process] = Counts(
                c.process, "", so_far.woken + c.woken, so_far.preempted + c.preempted,
                so_far.ran_ns + c.ran_ns, so_far.waited_ns + c.waited_ns,
            )  # fmt: skip
        return sums

    def usage(self) -> dict[str, Usage]:
        """Return the rates between the last two looks."""
        if len(self._samples) < 2:
            return {}
        older, newer = self._samples[-2], self._samples[-1]
        seconds = newer.at_s - older.at_s
        sums: dict[str, list[float]] = {}
        for before, now in _both(older, newer):
            woken, preempted = now.woken - before.woken, now.preempted - before.preempted
            ran, waited = now.ran_ns - before.ran_ns, now.waited_ns - before.waited_ns
            row = sums.setdefault(now.process, [0.0] * 4)
            for i, value in enumerate((woken, woken + preempted, 1e-9 * ran, 1e-9 * waited)):
                row[i] += value / seconds
        return {name: Usage(row[0], row[1], row[2], row[3], seconds) for name, row in sums.items()}

    def recent(self) -> tuple[ThreadTime, ...]:
        """Return who ran and who waited between the first and the last look that are kept, most first."""
        if len(self._samples) < 2:
            return ()
        older, newer = self._samples[0], self._samples[-1]
        seconds = newer.at_s - older.at_s
        times = [
            ThreadTime(
                now.process, now.thread, seconds, 1e-9 * (now.ran_ns - before.ran_ns),
                1e-9 * (now.waited_ns - before.waited_ns),
                now.woken - before.woken + now.preempted - before.preempted,
            )
            for before, now in _both(older, newer)
        ]  # fmt: skip
        return tuple(sorted(times, key=lambda each: -each.ran_s))


def _both(older: _Sample, newer: _Sample) -> Iterator[tuple[Counts, Counts]]:
    return ((older.threads[tid], now) for tid, now in newer.threads.items() if tid in older.threads)


def threads_of(name: str, pid: int, known: Collection[int]) -> Iterator[tuple[int, Counts]]:
    """Yield the threads of a process and of what it has started, as far as that has no name of its own."""
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
