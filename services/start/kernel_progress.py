"""How many kernels a process has ready, told while it compiles: the first start on a machine takes most of a minute."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from trocar.services.kernels import kernel_cache
from trocar.services.mechanics.compiled import KERNELS

_APART_S = 0.2  # a bar that moves five times a second is seen to move, for some microseconds each
#: Up to this share of what was expected the count is taken as it is; beyond, it approaches the end and never passes it.
_LINEAR = 0.9


class KernelProgress:
    """Counts our kernels that numba compiles or finds on disk.

    Args:
        say: Takes a line for people and how far it is, 0 to 1.
        expected: Kernels that are used in the end: counted once, as which they are depends on the scene.
    """

    def __init__(self, say: Callable[[str, float], None], expected: int) -> None:
        self._say, self._expected = say, expected
        self._stage = ""
        self._before, self._used_before = _compiled(), _used()

    def begin(self, stage: str) -> None:
        """Begin with what is called `stage`."""
        self._stage = stage
        self.tell()

    @property
    def count(self) -> int:
        """Kernels that were compiled, not found on disk."""
        return len(_compiled() - self._before)

    @property
    def used(self) -> int:
        """Kernels that were compiled or found on disk."""
        return len(_used() - self._used_before)

    def tell(self) -> None:
        """Say how many are compiled, and how far it is."""
        self._say(f"{self._stage}: {self.count} kernels compiled", approach(self.used / self._expected))


def approach(ratio: float) -> float:
    """Return how far a work is, of which a ratio of what was expected is done: more than expected is no end yet."""
    if ratio <= _LINEAR:
        return ratio
    rest = 1.0 - _LINEAR
    return 1.0 - rest * math.exp(-(ratio - _LINEAR) / rest)


@contextmanager
def told(say: Callable[[str, float], None], expected: int) -> Iterator[KernelProgress]:
    """Tell five times a second, from a thread, how many kernels have been compiled since; at its end, that it is."""
    progress, over = KernelProgress(say, expected), threading.Event()

    def tell() -> None:
        while not over.wait(_APART_S):
            progress.tell()

    teller = threading.Thread(target=tell, name="kernel progress", daemon=True)
    teller.start()
    try:
        yield progress
    finally:
        over.set()
        teller.join()
        kernel_cache.settle()
    say(f"{progress.count} kernels compiled", 1.0)


def _compiled() -> set[int]:
    """Return the places in `KERNELS` of those that were not found on disk."""
    return {k for k, each in enumerate(KERNELS) if each.stats.cache_misses}


def _used() -> set[int]:
    """Return the places in `KERNELS` of those that are there in machine code."""
    return {k for k, each in enumerate(KERNELS) if each.stats.cache_misses or each.stats.cache_hits}
