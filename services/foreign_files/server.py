"""A process that has imported what reads a kind of file, and forks a reader with limits for each one.

``python -m trocar.services.foreign_files.server LINK MODULE``, started by `trocar.services.foreign_files.client` only.
It runs no thread, reads nothing itself, and ends with the link. The functions of MODULE may be called: each yields the
messages of its answer. A reader that nobody listens to any more is killed.
"""

from __future__ import annotations

import trocar.services.start.entry  # noqa: F401  first: the environment of a process

# isort: split
import gc
import importlib
import math
import os
import resource
import selectors
import signal
import socket
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import msgspec

from trocar.services.foreign_files.packets import (
    ENDED,
    PACKET_MAX,
    REFUSED,
    REQUEST_MAX,
    CallRequest,
    Ended,
    Refused,
    send_message,
)

_TRACE_MAX = 8000  # characters of a traceback's end: some fifty calls, in less than one packet
_EXIT_REFUSED = 1  # as Python's own for an exception that nobody has caught


def main() -> None:
    """Fork a reader for each request, until the link ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal: who started this one decides
    link = socket.socket(fileno=int(sys.argv[1]))
    module = importlib.import_module(sys.argv[2])
    gc.freeze()
    _Server(link, module.__dict__).run()


class _Server:
    def __init__(self, link: socket.socket, functions: dict[str, Callable[..., Iterator[bytes]]]) -> None:
        self._link, self._functions = link, functions
        self._readers: dict[int, socket.socket] = {}
        self._selector = selectors.DefaultSelector()
        self._selector.register(link, selectors.EVENT_READ)
        woken, wake = socket.socketpair()
        for each in (woken, wake):
            each.setblocking(False)
        signal.set_wakeup_fd(wake.fileno(), warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda _signal, _frame: None)
        self._woken, self._wake = woken, wake
        self._selector.register(woken, selectors.EVENT_READ)

    def run(self) -> None:
        """Serve until the link ends; then no reader is left."""
        while True:
            for key, _ in self._selector.select():
                if key.fileobj is self._woken:
                    self._woken.recv(4096)
                    self._reap()
                elif key.fileobj is self._link:
                    if not self._serve():
                        self._kill_all()
                        return
                elif isinstance(key.data, Ended):
                    assert isinstance(key.fileobj, socket.socket)
                    self._tell(key.fileobj, key.data)
                elif key.data in self._readers:
                    self._selector.unregister(key.fileobj)  # nobody listens any more
                    _kill(key.data)

    def _serve(self) -> bool:
        data, descriptors, _flags, _address = socket.recv_fds(self._link, REQUEST_MAX, 1)
        if not data:
            return False
        request, sink = msgspec.json.decode(data, type=CallRequest), socket.socket(fileno=descriptors[0])
        pid = os.fork()
        if pid == 0:
            self._selector.close()
            signal.set_wakeup_fd(-1)
            self._link.close()
            for other in self._readers.values():
                other.close()
            _read(self._functions[request.function], request, sink)
        self._readers[pid] = sink
        self._selector.register(sink, selectors.EVENT_READ, pid)
        return True

    def _reap(self) -> None:
        """Tell how readers ended."""
        while self._readers:
            pid, status, used = os.wait4(-1, os.WNOHANG)
            if not pid:
                return
            sink = self._readers.pop(pid)
            with suppress(KeyError):
                self._selector.unregister(sink)
            ended = Ended(os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime, used.ru_maxrss << 10)
            self._selector.register(sink, selectors.EVENT_WRITE, ended)  # its buffer may be full

    def _tell(self, sink: socket.socket, ended: Ended) -> None:
        self._selector.unregister(sink)
        with sink, suppress(OSError):
            sink.send(ENDED + msgspec.json.encode(ended))

    def _kill_all(self) -> None:
        for pid in self._readers:
            _kill(pid)
        for pid in self._readers:
            os.waitpid(pid, 0)


def _kill(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def _read(function: Callable[..., Iterator[bytes]], request: CallRequest, sink: socket.socket) -> None:
    """Be a reader: send the messages of an answer, or why there is none, and end."""
    code = _EXIT_REFUSED
    try:
        _limit(request)
        arguments = {name: msgspec.json.decode(value) for name, value in request.arguments.items()}
        for message in function(**arguments):
            send_message(sink, message)
        code = 0
    except BrokenPipeError:
        pass  # nobody listens any more
    except BaseException as error:
        told = getattr(error, "is_told", False)
        kind = MemoryError if isinstance(error, MemoryError) else type(error)  # numpy has one of its own
        trace = "" if told or kind is MemoryError else traceback.format_exc()[-_TRACE_MAX:]
        refused = Refused(kind.__name__, _one_line(str(error)), told, trace)
        with suppress(OSError):
            sink.send(REFUSED + msgspec.json.encode(refused)[: PACKET_MAX - 1])
    finally:
        os._exit(code)


def _one_line(text: str) -> str:
    return " ".join(text.encode(errors="replace").decode().split())[:2000]


def _limit(request: CallRequest) -> None:
    """Take no more than the request grants, and write to no terminal."""
    gc.enable()
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(nowhere, descriptor)
    os.nice(request.nice)
    memory = _data_bytes() + request.memory_bytes
    resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    cpu_s = math.ceil(request.cpu_s)
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _data_bytes() -> int:
    """Return what the limit on data counts so far."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5]) * resource.getpagesize()


if __name__ == "__main__":
    main()
