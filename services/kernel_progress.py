"""How many kernels a process has compiled, told while it does: the first start on a machine takes most of a minute."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from trocar.services import kernel_cache
from trocar.services.mechanics.compiled import KERNELS

_APART_S = 0.2


class KernelProgress:
    """Counts our kernels that numba compiles.

    Args:
        say: Takes a line for people and how far it is, 0 to 1.
    """

    def __init__(self, say: Callable[[str, float], None]) -> None:
        self._say = say
        self._stage = ""
        self._before = _compiled()

    def begin(self, stage: str) -> None:
        """Begin with what is called `stage`."""
        self._stage = stage
        self.tell()

    @property
    def count(self) -> int:
        """Kernels that were compiled, not found on disk."""
        return len(_compiled() - self._before)

    def tell(self) -> None:
        """Say how many are compiled; a scene does not use all, so it may end before the last."""
        n, most = self.count, len(KERNELS)
        self._say(f"{self._stage}: {n} kernels compiled, of at most {most}", n / max(1, most))


@contextmanager
def told(say: Callable[[str, float], None]) -> Iterator[KernelProgress]:
    """Tell five times a second, from a thread, how many kernels have been compiled since."""
    progress, over = KernelProgress(say), threading.Event()

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
        progress.tell()


def _compiled() -> set[int]:
    """Return the places in `KERNELS` of those that were not found on disk."""
    return {k for k, each in enumerate(KERNELS) if each.stats.cache_misses}
