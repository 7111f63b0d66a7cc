"""A process that has imported what those of the rig import, and becomes one of them in a copy of itself.

``python -m services.supervisor.zygote LINK ROOM``, started by the supervisor only; its end of the link is its life. It
runs no thread, opens nothing and is of the ordinary class. ROOM is for the command lines of those it becomes. What it
bears is a child of the supervisor, which waits for it as for one that it has started itself: whoever bears it ends at
once, and orphans come to the supervisor meanwhile (`nursery`).
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
IMPORTED = ("services.scenes", "services.runtime.process", "services.kernel_progress")
_ORDER_MAX = 1 << 16
_OURS = "services.", "protocol."
READY = b"ready"
_LOOK_S = 0.5e-3


class Order(msgspec.Struct, frozen=True):
    """What a copy is to become: ``python -m MODULE ARGUMENTS``."""

    module: str
    arguments: tuple[str, ...]
    environment: dict[str, str]

    def command(self) -> list[str]:
        """Return the command line that does the same."""
        return [sys.executable, "-m", self.module, *self.arguments]


def main() -> None:
    """Bear processes until the link ends; in each of them run it."""
    gc.disable()  # each of them ends that: `start_up.end`
    link = socket.socket(fileno=int(sys.argv[1]))
    for name in IMPORTED:
        importlib.import_module(name)
    stamps = _stamps()
    gc.freeze()
    order = _serve(link)
    if order is None:
        return
    os.environ.update(order.environment)
    if _stamps() != stamps:  # the source is newer than what was imported
        os.execv(sys.executable, order.command())
    _show(order.command())
    sys.argv[:] = [order.module, *order.arguments]
    sys.orig_argv[:] = order.command()
    runpy.run_module(order.module, run_name="__main__", alter_sys=True)


def _serve(link: socket.socket) -> Order | None:
    """Return the order that is to be carried out here, in the copy that was born for it; None at the end of all."""
    said = READY
    while _told(link, said):
        data, sinks, _, _ = socket.recv_fds(link, _ORDER_MAX, 1)
        if not data:
            return None
        (sink,) = sinks
        pid = _bear()
        if pid == 0:
            link.close()
            _stand_alone(sink)
            return msgspec.json.decode(data, type=Order)
        os.close(sink)
        said = str(pid).encode()
    return None


def _told(link: socket.socket, said: bytes) -> bool:
    """Tell the supervisor; return whether it is still there."""
    try:
        link.send(said)
    except (BrokenPipeError, ConnectionResetError):
        return False
    return True


def _bear() -> int:
    """Return the process id of a copy that is nobody's child, -1 if there can be none; 0 in the copy itself."""
    told, tell = os.pipe()
    between = os.fork()
    if between == 0:
        os.close(told)
        parent = os.getpid()
        try:
            pid = os.fork()
        except OSError:
            pid = -1
        if pid == 0:
            os.close(tell)
            _await_end_of(parent)
            return 0
        os.write(tell, str(pid).encode())
        os._exit(0)
    os.close(tell)
    with open(told, "rb") as end:
        said = end.read()
    os.waitpid(between, 0)
    return int(said or -1)


def _await_end_of(parent: int) -> None:
    """Return once this process is no longer the child of `parent`: what it runs then sees the supervisor above it."""
    while os.getppid() == parent:
        time.sleep(_LOOK_S)


def _stand_alone(sink: int) -> None:
    """Lead a session, read nothing and write into `sink`."""
    os.setsid()
    nothing = os.open(os.devnull, os.O_RDONLY)
    for target, source in ((0, nothing), (1, sink), (2, sink)):
        os.dup2(source, target)
    os.close(nothing)
    os.close(sink)


def _stamps() -> dict[str, tuple[int, int]]:
    """Return age and size of the source of each module of ours that is imported."""
    found = {}
    for name, module in list(sys.modules.items()):
        path = getattr(module, "__file__", None)
        if path is not None and name.startswith(_OURS):
            with suppress(FileNotFoundError):
                status = os.stat(path)
                found[path] = status.st_mtime_ns, status.st_size
    return found


def _show(command: list[str]) -> None:
    """Write a command line over that of this process, as far as there is room: who lists processes is told by it."""
    fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    begin, end = int(fields[45]), int(fields[46])
    text = b"\0".join(map(os.fsencode, command))[: end - begin - 1]
    ctypes.memmove(begin, text.ljust(end - begin, b"\0"), end - begin)


if __name__ == "__main__":
    main()
