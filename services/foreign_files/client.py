"""Asking for what is in a file that others made: another process reads it, with limits, and sends data back."""

from __future__ import annotations

import atexit
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import msgspec

from trocar.services.foreign_files.limits import Limits, limits_of
from trocar.services.foreign_files.packets import (
    ENDED,
    LAST,
    PACKET_MAX,
    REFUSED,
    CallRequest,
    Ended,
    Refused,
)

_SERVER = "trocar.services.foreign_files.server"
#: What follows a packet's first byte at most; what a server may take to import what it needs, on a busy machine.
_RECEIVE_MAX, _START_S = PACKET_MAX + 1, 60.0
_END_S = 5.0  # as a rig's processes have

OnEnd = Callable[[Ended], None]


class Refusal(Exception):  # noqa: N818 - a file is refused
    """A file is not read; one sentence that names it.

    Attributes:
        kind: Name of the class of the reader's exception; of what no reader told: ``limit``, ``crash`` or ``ended``.
    """

    def __init__(self, kind: str, sentence: str) -> None:
        super().__init__(sentence)
        self.kind = kind


def ask(
    module: str,
    function: str,
    path: Path,
    limits: Limits | None = None,
    *,
    nice: int = 0,
    on_end: OnEnd | None = None,
    **arguments: Any,
) -> Generator[bytes, None, None]:
    """Yield the messages that a function yields of a file, in another process.

    The first question of this process to a module takes as long as its imports do, a later one some milliseconds.
    Raises Refusal if the file cannot be read within the limits, whatever is in it.

    Args:
        module: Holds the function, which takes ``path`` and `arguments`.
        function: Its name.
        path: The file that is read, and named.
        limits: Of the reader; None: by the size of the file.
        nice: Of the reader, beside this process.
        on_end: Told how the reader ended.
        arguments: What JSON can hold.
    """
    limits = limits or limits_of(path)
    encoded = {
        name: msgspec.Raw(json.dumps(value).encode()) for name, value in {"path": str(path), **arguments}.items()
    }
    request = CallRequest(function, encoded, limits.memory_bytes, limits.cpu_s, nice)
    with closing(_server(module).send(request)) as source:
        yield from _Answer(path, limits, source, on_end).messages()


def ask_once(module: str, function: str, path: Path, limits: Limits | None = None, **arguments: Any) -> list[bytes]:
    """Return all messages of `ask`."""
    return list(ask(module, function, path, limits, **arguments))


class _Answer:
    """The packets of one answer, as they come."""

    def __init__(self, path: Path, limits: Limits, source: socket.socket, on_end: OnEnd | None) -> None:
        self._path, self._limits, self._source, self._on_end = path, limits, source, on_end
        self._left_s, self._left_bytes = limits.wait_s + _START_S, limits.answer_bytes
        self._started = False

    def messages(self) -> Iterator[bytes]:
        parts: list[bytes] = []
        refused: Refused | None = None
        while True:
            kind, data = self._receive()
            if kind == ENDED:
                self._judge(msgspec.json.decode(data, type=Ended), refused)
                return
            if kind == REFUSED:
                refused = msgspec.json.decode(data, type=Refused)
                continue
            self._left_bytes -= len(data)
            if self._left_bytes < 0:
                raise Refusal("limit", f"{self._path}: holds more than {_size(self._limits.answer_bytes)} to hand on")
            parts.append(data)
            if kind == LAST:
                message, parts = (parts[0] if len(parts) == 1 else b"".join(parts)), []
                yield message

    def _receive(self) -> tuple[bytes, bytes]:
        began_s = time.monotonic()
        self._source.settimeout(max(self._left_s, 1e-3))
        try:
            packet = self._source.recv(_RECEIVE_MAX)
        except TimeoutError:
            raise self._too_long() from None
        self._left_s -= time.monotonic() - began_s
        if not self._started:
            self._started, self._left_s = True, min(self._left_s, self._limits.wait_s)
        if not packet:
            raise Refusal("ended", f"{self._path}: cannot be read: its reader was ended")
        return packet[:1], packet[1:]

    def _too_long(self) -> Refusal:
        return Refusal("limit", f"{self._path}: takes more than {self._limits.cpu_s:.0f} s to read")

    def _judge(self, ended: Ended, refused: Refused | None) -> None:
        if self._on_end is not None:
            self._on_end(ended)
        if refused is not None:
            raise self._refusal(refused)
        if ended.code == 0:
            return
        if -ended.code in (signal.SIGXCPU, signal.SIGKILL):
            raise self._too_long()
        how = signal.Signals(-ended.code).name if ended.code < 0 else f"exit code {ended.code}"
        raise Refusal("crash", f"{self._path}: is broken: what reads such files ended on it ({how})")

    def _refusal(self, refused: Refused) -> Refusal:
        if refused.is_told:
            return Refusal(refused.kind, refused.sentence)
        if refused.kind == "MemoryError":
            memory = _size(self._limits.memory_bytes)
            return Refusal("limit", f"{self._path}: takes more than {memory} of memory to read")
        said = f"{refused.kind}: {refused.sentence}" if refused.sentence else refused.kind
        refusal = Refusal(refused.kind, f"{self._path}: cannot be read ({said})")
        refusal.add_note(refused.trace)
        return refusal


def _size(n_bytes: int) -> str:
    return f"{n_bytes / (1 << 30):.2g} GiB" if n_bytes >= 1 << 30 else f"{n_bytes >> 20} MiB"


class _ServerLink:
    """A server process, and the link to it."""

    def __init__(self, module: str) -> None:
        self._link, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(each or os.getcwd() for each in sys.path)}
        with other:
            self._process = subprocess.Popen(
                [sys.executable, "-m", _SERVER, str(other.fileno()), module],
                stdin=subprocess.DEVNULL, env=environment, pass_fds=[other.fileno()], start_new_session=True,
            )  # fmt: skip

    def is_alive(self) -> bool:
        return self._process.poll() is None

    def send(self, request: CallRequest) -> socket.socket:
        """Send a request; return the socket of its answer."""
        source, sink = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with sink:
            socket.send_fds(self._link, [msgspec.json.encode(request)], [sink.fileno()])
        return source

    def forget(self) -> None:
        """Close the link in a fork of the process that has it."""
        self._link.close()
        self._process.returncode = 0  # it is no child of a fork

    def close(self) -> None:
        self._link.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


_servers: dict[str, _ServerLink] = {}
_is_at_end = False
_lock = threading.Lock()


def _server(module: str) -> _ServerLink:
    """Return the server of a module, started with its first use."""
    with _lock:
        if _is_at_end:
            raise Refusal("ended", "nothing is read any more: this process ends")
        found = _servers.get(module)
        if found is None or not found.is_alive():
            if found is not None:
                found.close()
            found = _servers[module] = _ServerLink(module)
        return found


def close_all() -> None:
    """End all servers of this process; a later question starts them again."""
    with _lock:
        while _servers:
            _servers.popitem()[1].close()


def _forget_all() -> None:
    global _lock
    _lock = threading.Lock()
    while _servers:
        _servers.popitem()[1].forget()


def _end() -> None:
    """End all servers for good; a thread may still ask."""
    global _is_at_end
    _is_at_end = True
    close_all()


atexit.register(_end)
os.register_at_fork(after_in_child=_forget_all)
