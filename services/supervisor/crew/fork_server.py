"""A process that imports the modules of the rig's processes once, and forks each process on request.

``python -m trocar.services.supervisor.crew.fork_server LINK ROOM``, started by the supervisor only (`fork_link`), whose
end of the link decides its life. It runs no thread and opens nothing. ROOM pads its command line for its forks.
A fork becomes a child of the supervisor, because the process between them ends at once.
"""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import ctypes
import gc
import importlib
import os
import runpy
import socket
import sys
import time
from contextlib import suppress
from pathlib import Path

import msgspec

#: The slowest imports of the rig's processes; their pages are shared by all, also by processes that do not use them.
IMPORTED = (
    "trocar.services.scenes",
    "trocar.services.runtime.process.process",
    "trocar.services.start.kernel_progress",
)
READY, GO, ALIVE = b"ready", b"go", b"alive?"
_ORDER_MAX = 1 << 16  # a module, its arguments and a few variables; by default a Linux socket takes thrice as much
_LOOK_S = 0.5e-3  # until the kernel has given the child its new parent: short against a start, which takes seconds


class ForkOrder(msgspec.Struct, frozen=True):
    """Order to fork ``python -m MODULE ARGUMENTS``."""

    module: str
    arguments: tuple[str, ...]
    environment: dict[str, str]


def main() -> None:
    """Fork until the link ends, and run the ordered module in each fork."""
    gc.disable()  # each fork enables it again: `start_up.end`
    link = socket.socket(fileno=int(sys.argv[1]))
    for name in IMPORTED:
        importlib.import_module(name)
    _call_a_kernel()
    gc.freeze()
    _tell(link, READY)
    while (received := socket.recv_fds(link, _ORDER_MAX, 2))[0]:
        if received[0] == ALIVE:
            _tell(link, READY)
            continue
        order, (sink, asker) = msgspec.json.decode(received[0], type=ForkOrder), received[1]
        if _fork():
            link.close()
            if _may_run(socket.socket(fileno=asker)):
                _stand_alone(sink)
                _become(order)
            return
        os.close(sink)
        os.close(asker)


def _call_a_kernel() -> None:
    """Call some kernel: with the first one numba imports 250 more modules, in each process that has not done so."""
    from trocar.services.kernels import kernel_cache
    from trocar.services.mechanics.compiled import vectors

    vectors.dot((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    kernel_cache.settle()


def _may_run(asker: socket.socket) -> bool:
    """Tell who asked for this process that it exists; return whether it is still wanted."""
    with asker:
        _tell(asker, str(os.getpid()).encode())
        try:
            return asker.recv(len(GO)) == GO
        except ConnectionResetError:
            return False


def _tell(link: socket.socket, what: bytes) -> None:
    """Send a message to the supervisor, which may have ended."""
    with suppress(BrokenPipeError, ConnectionResetError):
        link.send(what)


def _fork() -> bool:
    """Fork; return True in the new child of the supervisor, False in the server."""
    if between := os.fork():
        os.waitpid(between, 0)
        return False
    parent = os.getpid()
    if os.fork():
        os._exit(0)
    while os.getppid() == parent:
        time.sleep(_LOOK_S)
    return True


def _stand_alone(sink: int) -> None:
    """Start a session, and redirect the output to `sink`."""
    os.setsid()
    for target in (1, 2):
        os.dup2(sink, target)
    os.close(sink)


def _become(order: ForkOrder) -> None:
    command = [sys.executable, "-m", order.module, *order.arguments]
    _show(command)
    os.environ.update(order.environment)
    sys.path[1:1] = filter(None, order.environment.get("PYTHONPATH", "").split(os.pathsep))
    sys.argv[:] = [order.module, *order.arguments]
    sys.orig_argv[:] = command
    runpy.run_module(order.module, run_name="__main__", alter_sys=True)


def _show(command: list[str]) -> None:
    """Overwrite this process' command line, as far as it fits, for process listings."""
    fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    begin, end = int(fields[45]), int(fields[46])
    text = b"\0".join(map(os.fsencode, command))[: end - begin - 1]
    ctypes.memmove(begin, text.ljust(end - begin, b"\0"), end - begin)


if __name__ == "__main__":
    main()
