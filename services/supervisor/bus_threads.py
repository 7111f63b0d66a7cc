"""Whether silence on the bus is the others' or our own: the bus' thread may be waiting for a processor.

On a busy machine frames lie in the system's buffers while ZeroMQ's thread of this ordinary process is not run. As long
as it is runnable there is something that we have not heard yet, and nobody can be called silent.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

_THREAD = "ZMQbg/IO"


class BusThreads:
    """The bus' threads of this process, as they are when this is made."""

    def __init__(self) -> None:
        self._states = [os.open(task / "stat", os.O_RDONLY) for task in _bus_threads()]

    def are_idle(self) -> bool:
        """Return whether everything that has arrived was heard: no thread of the bus is running or waiting to."""
        states = (os.pread(state, 512, 0).rpartition(b")")[2].split(maxsplit=1)[0] for state in self._states)
        return b"R" not in states

    def close(self) -> None:
        """Let go of the descriptors."""
        for state in self._states:
            os.close(state)


def _bus_threads() -> Iterator[Path]:
    for task in Path("/proc/self/task").iterdir():
        if (task / "comm").read_text().startswith(_THREAD):
            yield task
