"""Opens a bus or a device in a thread of its own: that takes seconds, and the servo goes on meanwhile."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class BackgroundOpen(Generic[T]):
    """Opens a bus or a device, and keeps it until it is taken.

    Args:
        open_it: Returns what was opened; what it raises is why there is none.
    """

    def __init__(self, open_it: Callable[[], T]) -> None:
        self._open_it = open_it
        self._opened: T | None = None
        self._problem = ""
        self._thread = threading.Thread(target=self._run, name="opens-a-device", daemon=True)
        self._thread.start()

    @property
    def done(self) -> bool:
        """Whether it is open, or cannot be opened."""
        return not self._thread.is_alive()

    def take(self) -> tuple[T | None, str]:
        """Wait until it is done; return what was opened, or why there is none."""
        self._thread.join()
        opened, self._opened = self._opened, None
        return opened, self._problem

    def _run(self) -> None:
        with contextlib.suppress(OSError):  # the servo's priority is not for what takes seconds
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        try:
            self._opened = self._open_it()
        except Exception as error:  # whatever it is: the servo goes on, and without it
            self._problem = str(error) or type(error).__name__
