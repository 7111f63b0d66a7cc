"""A process that has imported what those of the rig import, and forks each of them when it is told to.

``python -m services.supervisor.fork_server LINK ROOM``, started by the supervisor only (`fork_link`), whose end of the
link is its life. It runs no thread, opens nothing and writes nothing. ROOM is room for the command lines of those that
it becomes. A fork is handed over to the supervisor: whoever stands between them ends at once.
"""

from __future__ import annotations

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

#: What takes longest of the imports of the rig's processes. Whoever has no use for it shares its pages with the others.
IMPORTED = "services.scenes", "services.runtime.process", "services.kernel_progress"
READY = b"ready"
_ORDER_MAX = 1 << 16
_LOOK_S = 0.5e-3


class ForkOrder(msgspec.Struct, frozen=True):
    """What a fork is to become: ``python -m MODULE ARGUMENTS``."""

    module: str
    arguments: tuple[str, ...]
    environment: dict[str, str]


def main() -> None:
    """Fork until the link ends; in each fork run what was ordered."""
    gc.disable()  # each of them ends that: `start_up.end`
    link = socket.socket(fileno=int(sys.argv[1]))
    for name in IMPORTED:
        importlib.import_module(name)
    gc.freeze()
    _tell(link, READY)
    while (received := socket.recv_fds(link, _ORDER_MAX, 1))[0]:
        order, (sink,) = msgspec.json.decode(received[0], type=ForkOrder), received[1]
        if _fork():
            _tell(link, str(os.getpid()).encode())
            link.close()
            _stand_alone(sink)
            _become(order)
            return
        os.close(sink)


def _tell(link: socket.socket, what: bytes) -> None:
    """Tell the supervisor, which may have ended meanwhile."""
    with suppress(BrokenPipeError, ConnectionResetError):
        link.send(what)


def _fork() -> bool:
    """Return whether this is a fork, a child of the supervisor by now, and not the server itself."""
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
    """Lead a session, and write into `sink`."""
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
    """Write a command line over that of this process, as far as there is room: who lists processes is told by it."""
    fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    begin, end = int(fields[45]), int(fields[46])
    text = b"\0".join(map(os.fsencode, command))[: end - begin - 1]
    ctypes.memmove(begin, text.ljust(end - begin, b"\0"), end - begin)


if __name__ == "__main__":
    main()
