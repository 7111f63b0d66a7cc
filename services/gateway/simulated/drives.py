"""The gateway's connection to the process of its emulated drives."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Collection, Iterator

from trocar.services.gateway.can.local_bus import LocalBus
from trocar.services.gateway.simulated import drive_orders
from trocar.services.gateway.simulated.drive_orders import Add, Ask, Order
from trocar.services.gateway.simulated.hand_motion import HandMotion

_STOP_TIMEOUT_S = 2.0  # a hundred times what it needs to hear of its end: a busy machine delays it
_ANSWER_TIMEOUT_S = 5.0  # its start takes most of a second, and no hand waits for it

#: Signals by which a person or a service ends a rig, all its processes at once. The drives outlive them, as real ones:
#: they go on for as long as the gateway lets the hands go, and end with it.
_ENDS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP

_running: dict[tuple[int | None, int | None], DriveProcess] = {}
#: Guards the search, as handles are reopened in threads of their own.
_finding = threading.Lock()


class DriveProcess:
    """Starts with the first drive that joins, ends with the last that leaves.

    Args:
        core, priority: Its core and real-time priority; None for any core and no priority.
    """

    def __init__(self, core: int | None, priority: int | None) -> None:
        self._key = core, priority
        self._nodes: set[int] = set()
        self._orders, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        words = ["-" if each is None else str(each) for each in self._key]
        command = [sys.executable, "-m", "trocar.services.gateway.simulated.drive_process", *words]
        with theirs, _blocked(_ENDS):
            self._process: subprocess.Popen[bytes] = subprocess.Popen(command, stdin=theirs.fileno())

    def join(self, node: int, watchdog_s: float, motion: HandMotion) -> LocalBus:
        """Add a drive and return its bus, on which it answers once the process has started."""
        self._nodes.add(node)
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        with theirs, os.fdopen(os.memfd_create("motion"), "wb", 0) as table, contextlib.suppress(BrokenPipeError):
            table.write(motion.angle_rad.tobytes())
            order = drive_orders.encode(Add(node, watchdog_s, motion.repeats))
            socket.send_fds(self._orders, [order], [theirs.fileno(), table.fileno()])
        return LocalBus(ours)

    def leave(self, node: int) -> None:
        """Remove a drive; with the last one the process ends."""
        self._nodes.discard(node)
        if self._nodes:
            return
        if _running.get(self._key) is self:
            del _running[self._key]
        self._orders.close()
        try:
            self._process.wait(_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def kill(self) -> None:
        """Kill the process, with all its drives."""
        self._process.kill()
        self._process.wait()
        self._orders.close()

    def order(self, order: Order) -> None:
        """Give an order to a drive. Never waits, and does nothing if the process has ended."""
        with contextlib.suppress(OSError):
            self._tell(order)

    def applied_nm(self, node: int) -> float:
        """Return the torque that a drive applies now, waiting for its answer."""
        self._tell(Ask(node))
        if not select.select((self._orders,), (), (), _ANSWER_TIMEOUT_S)[0]:
            raise TimeoutError("the process of the emulated drives does not answer")
        return float(struct.unpack("=d", self._orders.recv(8))[0])

    def _tell(self, order: Order) -> None:
        self._orders.send(drive_orders.encode(order), socket.MSG_DONTWAIT)

    def end(self) -> int | None:
        """Return its exit code once it has ended."""
        return self._process.poll()


@contextlib.contextmanager
def _blocked(signals: Collection[signal.Signals]) -> Iterator[None]:
    """Block signals in this thread, and for good in a process that it starts meanwhile."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def find_process(core: int | None, priority: int | None) -> DriveProcess:
    """Return the process for drives on this core, started if there is none yet; thread-safe."""
    key = core, priority
    with _finding:
        if key not in _running or _running[key].end() is not None:
            _running[key] = DriveProcess(core, priority)
        return _running[key]
