"""For how long threads of a process waited in a run queue, from the kernel's statistics (`schedstat`).

A heartbeat passes through two threads: the loop's, and ZeroMQ's that sends it. Other processes may keep either from
running. The same holds for the supervisor's own: while its bus thread is runnable, something is not heard yet.
"""

from __future__ import annotations

import os
import time

_BUS, _SENDS = b"ZMQbg/", b"ZMQbg/IO"
#: A thread has the name of who made it until it has run for as long as it takes to say its own.
_NAMED_AFTER_NS = 50_000


class ThreadWait:
    """Files of the kernel about one thread, kept open: they never speak of another that takes its number.

    Raises OSError if it has ended.

    Args:
        tasks: Descriptor of the process' folder of threads, ``/proc/PID/task``.
        thread: Its number.
    """

    def __init__(self, tasks: int, thread: int) -> None:
        self._stat = os.open(f"{thread}/stat", os.O_RDONLY, dir_fd=tasks)
        self._schedule = _open_schedule(tasks, thread)
        self._ran_ns = -1
        self._waited_ns = 0
        self._looked_s = 0.0
        self._waiting_since_s: float | None = None

    def state(self) -> bytes:
        """Return the letter that the kernel has for what it does, nothing once it has ended."""
        text = read(self._stat).rpartition(b")")[2].split(maxsplit=1)
        return text[0] if text else b""

    def look(self, state: bytes | None = None) -> None:
        """Find out whether it waits now; its state is asked for only where that is not clear without, and not given."""
        words = b"" if self._schedule is None else read(self._schedule)
        ran_ns, waited_ns = map(int, words.split()[:2]) if words else (self._ran_ns + 1, self._waited_ns)
        if ran_ns != self._ran_ns or (self.state() if state is None else state) != b"R":
            self._waiting_since_s = None
        elif self._waiting_since_s is None:
            self._waiting_since_s = self._looked_s
        self._ran_ns, self._waited_ns, self._looked_s = ran_ns, waited_ns, time.monotonic()

    def waited_s(self) -> float:
        """Return for how long it has waited since its start, as of the last look; 0 where unknown.

        A wait that goes on counts from when it was last looked at, and had run since.
        """
        ended_s = self._waited_ns * 1e-9
        return ended_s if self._waiting_since_s is None else ended_s + self._looked_s - self._waiting_since_s

    def close(self) -> None:
        """Let go of the files."""
        for file in (self._stat, self._schedule):
            if file is not None:
                os.close(file)


class BusWaits:
    """The waits of the threads that send for a process; threads are listed when their number has changed.

    Args:
        tasks: As of `ThreadWait`; it stays the caller's.
    """

    def __init__(self, tasks: int) -> None:
        self._tasks = tasks
        self._links = -1
        self._threads: dict[int, ThreadWait] = {}
        self._ended_s = 0.0

    def waited_s(self) -> float:
        """Return for how long they have waited, together, since their start: one alone mostly, a context has one."""
        links = os.fstat(self._tasks).st_nlink
        if links != self._links:
            self._links = links if self._list() else -1
        for thread in self._threads.values():
            thread.look()
        return self._ended_s + sum(thread.waited_s() for thread in self._threads.values())

    def close(self) -> None:
        """Let go of the files."""
        for thread in self._threads.values():
            thread.close()

    def _list(self) -> bool:
        """Take up new threads of the bus and drop ended ones; return whether all have a name of their own."""
        try:
            found = {int(name) for name in os.listdir(self._tasks)}
        except OSError:  # the process has ended
            found = set()
        for ended in self._threads.keys() - found:
            thread = self._threads.pop(ended)
            self._ended_s += thread.waited_s()
            thread.close()
        named = [self._take(thread) for thread in found - self._threads.keys()]  # every one is taken
        return all(named)

    def _take(self, thread: int) -> bool:
        try:
            name = _read_once(self._tasks, f"{thread}/comm")
            if name.startswith(_SENDS):
                self._threads[thread] = ThreadWait(self._tasks, thread)
            if name.startswith(_BUS):
                return True
            words = _read_once(self._tasks, f"{thread}/schedstat").split()
        except OSError:  # it has ended, or this kernel has no such statistics
            return True
        return not words or int(words[0]) >= _NAMED_AFTER_NS


class OwnIoThreads:
    """ZeroMQ's I/O threads of this process, as they are when this is made.

    On a busy machine frames lie in the system's buffers while such a thread of an ordinary process is not run. As long
    as it is runnable, silence on the bus may be our own, and no process can be called silent.
    """

    def __init__(self) -> None:
        tasks = os.open("/proc/self/task", os.O_RDONLY | os.O_DIRECTORY)
        names = os.listdir(tasks)
        found = [int(name) for name in names if _read_once(tasks, f"{name}/comm").startswith(_SENDS)]
        self._threads = [ThreadWait(tasks, thread) for thread in found]
        os.close(tasks)

    def are_idle(self) -> bool:
        """Return whether everything that has arrived was heard: no such thread runs or waits to."""
        return all(thread.state() != b"R" for thread in self._threads)

    def close(self) -> None:
        """Let go of the files."""
        for thread in self._threads:
            thread.close()


def read(file: int) -> bytes:
    """Return what a file of the kernel says, nothing of a thread or process that has ended."""
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
    """Return a descriptor of the thread's statistics, which not every kernel has."""
    try:
        return os.open(f"{thread}/schedstat", os.O_RDONLY, dir_fd=tasks)
    except FileNotFoundError:
        return None
