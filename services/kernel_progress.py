"""How many kernels a process has compiled, told while it does: the first start on a machine takes most of a minute."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event
from numba.core.dispatcher import Dispatcher

_COMPILE = "numba:compile"
_APART_S = 0.2


class KernelProgress(event.Listener):  # type: ignore[misc]  # numba is not typed
    """Counts kernels of ours that numba compiles, and tells of them five times a second.

    Parameters
    ----------
    say
        Takes a line for people and how far it is, 0 to 1.
    """

    def __init__(self, say: Callable[[str, float], None]) -> None:
        self._say = say
        self._stage = ""
        self._compiled: set[str] = set()
        self._all = _kernels()
        self._said_s = 0.0

    def begin(self, stage: str) -> None:
        """Begin with what is called `stage`."""
        self._stage = stage
        self._tell()

    @property
    def count(self) -> int:
        """Kernels that were compiled, not found on disk."""
        return len(self._compiled & self._all)

    def on_start(self, event: Any) -> None:
        """Wait for the end."""

    def on_end(self, event: Any) -> None:
        """Count a kernel that is compiled."""
        self._compiled.add(_name(event.data["dispatcher"]))
        if time.monotonic() - self._said_s >= _APART_S:
            self._tell()

    def _tell(self) -> None:
        """Say what there is to say: what a scene does not use is never compiled, so it may end before the last."""
        self._said_s = time.monotonic()
        n, most = self.count, len(self._all)
        self._say(f"{self._stage}: {n} kernels compiled, of at most {most}", n / max(1, most))


@contextmanager
def told(say: Callable[[str, float], None]) -> Iterator[KernelProgress]:
    """Tell of the kernels that are compiled meanwhile, of those in modules that are imported by now."""
    progress = KernelProgress(say)
    event.register(_COMPILE, progress)
    try:
        yield progress
    finally:
        event.unregister(_COMPILE, progress)


def _kernels() -> set[str]:
    """Return the names of our kernels in the modules that are imported."""
    modules = [module for name, module in sys.modules.items() if name.startswith("services.")]
    found = (value for module in modules for value in vars(module).values() if isinstance(value, Dispatcher))
    return {_name(each) for each in found}


def _name(dispatcher: Any) -> str:
    """Return what a kernel and its twin for other kernels have in common."""
    function = dispatcher.py_func
    return f"{function.__module__}.{function.__qualname__}".removesuffix(".within_kernels")
