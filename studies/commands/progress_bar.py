"""What a long command says while it works, on standard error: a bar at a terminal, elsewhere a line now and then."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from trocar.studies.progress import Tell

EVERY_S = 10.0
"""Between two lines where there is no terminal."""


class Estimate:
    """How far a piece of work is, and how long it will still take if it goes on as it has; work may have parts."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began_s = self._part_s = clock()
        self._what, self._done, self._first, self._total = "", 0, 0, 0

    def tell(self, what: str, done: int, total: int) -> None:
        """Take how far the work is; another total, or less that is done, is another part."""
        if total != self._total or done < self._done:
            self._part_s, self._first = self._clock(), done
        self._what, self._done, self._total = what, done, total

    def left_s(self) -> float | None:
        """Return the seconds that the present part still takes, None while none of it is done."""
        done = self._done - self._first
        if done <= 0:
            return None
        elapsed_s = self._clock() - self._part_s
        return max(0.0, elapsed_s * (self._total - self._done) / done)

    def line(self) -> str:
        """Return all of it in a line."""
        left_s = self.left_s()
        left = "time left not known yet" if left_s is None else f"about {in_words(left_s)} left of it"
        count = f": {self._done} of {self._total}" if self._total else ""
        return f"{self._what or 'preparing'}{count}, {left}; {in_words(self._clock() - self._began_s)} so far"


def in_words(seconds: float) -> str:
    """Return a length of time as one says it."""
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


@contextmanager
def progress_line() -> Iterator[Tell]:
    """Yield what is to be told: what is worked on, how much of it is done, how much it is in all."""
    console = Console(stderr=True)
    with _bar(console) if console.is_terminal else _lines() as tell:
        yield tell


@contextmanager
def _bar(console: Console) -> Iterator[Tell]:
    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=None)

        def tell(what: str, done: int, total: int) -> None:
            progress.update(task, description=what, completed=done, total=total)

        yield tell


@contextmanager
def _lines() -> Iterator[Tell]:
    """Say a line every `EVERY_S`, also while one step takes longer than that."""
    estimate, ended = Estimate(), threading.Event()

    def say() -> None:
        while not ended.wait(EVERY_S):
            print(estimate.line(), file=sys.stderr, flush=True)

    teller = threading.Thread(target=say, daemon=True)
    teller.start()
    try:
        yield estimate.tell
    finally:
        ended.set()
        teller.join()
