"""Waits of a process' threads in run queues, from the kernel's statistics (`schedstat`).

A heartbeat passes through two threads, the loop's and ZeroMQ's, and other processes may keep either from running. The
same holds for the supervisor: while its own bus thread is runnable, messages may be unread.
"""

from __future__ import annotations

import os
import time

_BUS, _SENDS = b"ZMQbg/", b"ZMQbg/IO"
#: A new thread has its creator's name until it has run this long and has set its own.
_NAMED_AFTER_NS = 50_000


class ThreadWait:
    """The kernel's files about one thread, kept open so that they never refer to a later one of the same id.

    Raises OSError if it has ended.

    Args:
        tasks: Descriptor of the process' directory of threads, ``/proc/PID/task``.
        thread: Thread id.
    """

    def __init__(self, tasks: int, thread: int) -> None:
        self._stat = os.open(f"{thread}/stat", os.O_RDONLY, dir_fd=tasks)
        self._schedule = _open_schedule(tasks, thread)
        self._ran_ns = -1
        self._waited_ns = 0
        self._looked_s = 0.0
        self._waiting_since_s: float | None = None

    def state(self) -> bytes:
        """Return the kernel's letter of its state, empty once it has ended."""
        text = read(self._stat).rpartition(b")")[2].split(maxsplit=1)
        return text[0] if text else b""

    def look(self, state: bytes | None = None) -> None:
        """Determine whether it waits now, reading its state only if necessary and not given."""
        words = b"" if self._schedule is None else read(self._schedule)
        ran_ns, waited_ns = map(int, words.split()[:2]) if words else (self._ran_ns + 1, self._waited_ns)
        if ran_ns != self._ran_ns or (self.state() if state is None else state) != b"R":
            self._waiting_since_s = None
        elif self._waiting_since_s is None:
            self._waiting_since_s = self._looked_s
        self._ran_ns, self._waited_ns, self._looked_s = ran_ns, waited_ns, time.monotonic()

    def waited_s(self) -> float:
        """Return its waits since its start, as of the last `look`; 0 if unknown.

        A present wait counts from the last `look` at which it had run.
        """
        ended_s = self._waited_ns * 1e-9
        return ended_s if self._waiting_since_s is None else ended_s + self._looked_s - self._waiting_since_s

    def close(self) -> None:
        """Close the files."""
        for file in (self._stat, self._schedule):
            if file is not None:
                os.close(file)


class BusWaits:
    """Waits of the threads that send for a process; they are listed again when the number of threads changes.

    Args:
        tasks: As in `ThreadWait`; it is not closed here.
    """

    def __init__(self, tasks: int) -> None:
        self._tasks = tasks
        self._links = -1
        self._threads: dict[int, ThreadWait] = {}
        self._ended_s = 0.0

    def waited_s(self) -> float:
        """Return the sum of their waits since their start; a context mostly has one thread."""
        links = os.fstat(self._tasks).st_nlink
        if links != self._links:
            self._links = links if self._list() else -1
        for thread in self._threads.values():
            thread.look()
        return self._ended_s + sum(thread.waited_s() for thread in self._threads.values())

    def close(self) -> None:
        """Close the files."""
        for thread in self._threads.values():
            thread.close()

    def _list(self) -> bool:
        """Add new threads of the bus and remove ended ones; return whether all have a name of their own."""
        try:
            found = {int(name) for name in os.listdir(self._tasks)}
        except OSError:  # the process has ended
            found = set()
        for ended in self._threads.keys() - found:
            thread = self._threads.pop(ended)
            self._ended_s += thread.waited_s()
            thread.close()
        named = [self._take(thread) for thread in found - self._threads.keys()]  # a list, so that all are added
        return all(named)

    def _take(self, thread: int) -> bool:
        try:
            name = _read_once(self._tasks, f"{thread}/comm")
            if name.startswith(_SENDS):
                self._threads[thread] = ThreadWait(self._tasks, thread)
            if name.startswith(_BUS):
                return True
            words = _read_once(self._tasks, f"{thread}/schedstat").split()
        except OSError:  # it has ended, or the kernel has no such statistics
            return True
        return not words or int(words[0]) >= _NAMED_AFTER_NS


class OwnIoThreads:
    """ZeroMQ's I/O threads of this process at the time of construction.

    On a busy machine frames stay in the system's buffers while such a thread of an ordinary process does not run. As
    long as it is runnable, silence on the bus may be our own fault, and no process counts as silent.
    """

    def __init__(self) -> None:
        tasks = os.open("/proc/self/task", os.O_RDONLY | os.O_DIRECTORY)
        names = os.listdir(tasks)
        found = [int(name) for name in names if _read_once(tasks, f"{name}/comm").startswith(_SENDS)]
        self._threads = [ThreadWait(tasks, thread) for thread in found]
        os.close(tasks)

    def are_idle(self) -> bool:
        """Return whether all arrived messages were received: no such thread is running or runnable."""
        return all(thread.state() != b"R" for thread in self._threads)

    def close(self) -> None:
        """Close the files."""
        for thread in self._threads:
            thread.close()


def read(file: int) -> bytes:
    """Return the content of a file of the kernel, empty if the thread or process has ended."""
    try:
        return os.pread(file, 4096, 0)
    except OSError:
        return b""


def _read_once(tasks: int, path: str) -> bytes:
    file = os.open(path, os.O_RDONLY, dir_fd=tasks)
    try:
        return read(file)
    finally:
        os.close(file)


def _open_schedule(tasks: int, thread: int) -> int | None:
    """Return a descriptor of the thread's statistics, None if the kernel has none."""
    try:
        return os.open(f"{thread}/schedstat", os.O_RDONLY, dir_fd=tasks)
    except FileNotFoundError:
        return None
