"""Opens a bus or a device in a thread of its own, as that takes seconds and the servo must continue."""

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
        open_it: Returns the opened object; an exception's message is the reason of a failure.
    """

    def __init__(self, open_it: Callable[[], T]) -> None:
        self._open_it = open_it
        self._opened: T | None = None
        self._problem = ""
        self._thread = threading.Thread(target=self._run, name="opens-a-device", daemon=True)
        self._thread.start()

    @property
    def done(self) -> bool:
        """Whether opening has succeeded or failed."""
        return not self._thread.is_alive()

    def take(self) -> tuple[T | None, str]:
        """Wait until it is done; return the opened object, or the reason of the failure."""
        self._thread.join()
        opened, self._opened = self._opened, None
        return opened, self._problem

    def _run(self) -> None:
        with contextlib.suppress(OSError):  # work of seconds must not have the servo's priority
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        try:
            self._opened = self._open_it()
        except Exception as error:  # the servo continues without the device, whatever the error
            self._problem = str(error) or type(error).__name__
