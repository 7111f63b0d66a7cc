"""A bus that is opened while the servo goes on: what takes seconds is done in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable

import can


class Opening:
    """Opens a bus, and keeps it until it is taken.

    Parameters
    ----------
    open_bus
        Returns the bus; what it raises is why there is none.
    """

    def __init__(self, open_bus: Callable[[], can.BusABC]) -> None:
        self._open_bus = open_bus
        self._bus: can.BusABC | None = None
        self._problem = ""
        self._thread = threading.Thread(target=self._run, name="opens-a-bus", daemon=True)
        self._thread.start()

    @property
    def done(self) -> bool:
        """Whether it is open, or cannot be opened."""
        return not self._thread.is_alive()

    def take(self) -> tuple[can.BusABC | None, str]:
        """Wait until it is done; return the bus, or why there is none."""
        self._thread.join()
        bus, self._bus = self._bus, None
        return bus, self._problem

    def _run(self) -> None:
        try:
            self._bus = self._open_bus()
        except Exception as error:  # whatever it is: the servo goes on, and without a bus
            self._problem = str(error) or type(error).__name__
