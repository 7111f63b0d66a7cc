"""Endpoints of topics, derived from their names and the rig's transport, each guarded by a lock.

A second bind on an ipc path succeeds and silently takes it over, so a publisher holds an exclusive lock on
``<topic>.lock`` as long as it lives; the kernel releases it when the process ends in any way. It does so with every
transport, since the locks also tell which processes of a rig live on this host. One that is still compiling publishes
nothing yet, so each process holds ``<process>.lock`` from its start.
"""

from __future__ import annotations

import fcntl
import os
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO

from trocar.protocol.topics import PROCESSES, TOPICS, published_by
from trocar.services.runtime.config.rig import Transport
from trocar.services.runtime.errors import BusError
from trocar.services.runtime.private_directory import make_private, open_text

_MAX_IPC_PATH = 107  # unix(7): `sun_path` has 108 bytes, the last of them zero, on Linux
#: Ports among which topics are distributed by their names. `Transport.base_port` ends at 57000, so all are below 65536.
_PORTS = 8192
#: Suffix of the endpoint of a topic's batches, see `trocar.services.runtime.bus.frame_batches`.
_BATCHES = ".whole"


def run_directory(transport: Transport) -> Path:
    """Return the directory of the rig's sockets and locks, private to this user.

    That is ``transport.directory``, else one in ``$XDG_RUNTIME_DIR``, else one in ``/tmp``.
    Raises BusError if it cannot be created, or is accessible to others.
    """
    directory = transport.directory
    if directory is None:
        named = Path(os.environ.get("XDG_RUNTIME_DIR", ""))
        # A relative path is invalid (XDG Base Directory Specification); each folder would have a rig of its own.
        directory = (named if named.is_absolute() else Path("/tmp")) / f"trocar-{os.getuid()}"
    return make_private(directory)


def endpoint(transport: Transport, topic: str, host: str | None = None) -> str:
    """Return the ZeroMQ endpoint of `topic`, for tcp at `host`, by default the publisher's in the rig file.

    Raises BusError if an ipc path is longer than the system allows.
    """
    if transport.kind == "tcp":
        port = transport.base_port + zlib.crc32(topic.encode()) % _PORTS
        publisher = topic.split(".")[0]
        return f"tcp://{host or transport.address(publisher)}:{port}"
    return f"ipc://{ipc_path(transport, topic)}"


def ipc_path(transport: Transport, topic: str) -> str:
    """Return the path of the socket of `topic` on this host, or raise as `endpoint` does."""
    return _ipc_path(run_directory(transport), topic)


def check(transport: Transport) -> None:
    """Check that a directory is not too deep for sockets, without creating anything.

    Raises BusError naming a path that is longer than the system allows.
    """
    if transport.kind == "ipc" and transport.directory is not None:
        for topic in TOPICS:
            _ipc_path(transport.directory, f"{topic}{_BATCHES}")


def _ipc_path(directory: Path, topic: str) -> str:
    path = str(directory / f"{topic}.ipc")
    if len(path) > _MAX_IPC_PATH:
        raise BusError(f"transport.directory: the socket path {path} has {len(path)} characters, the system allows 107")
    return path


def claim(transport: Transport, name: str) -> IO[str]:
    """Acquire and return the lock of a topic or a process, which is released by closing it or by the process' end.

    Raises BusError naming the process that holds it.
    """
    path = run_directory(transport) / f"{name}.lock"
    while True:
        lock = open_text(path, os.O_RDWR | os.O_CREAT)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = lock.read().strip() or "unknown"
            lock.close()
            what = f"topic {name} is already published" if name in TOPICS else f"{name} is already run"
            raise BusError(f"{what} by process {holder} (lock {path})") from None
        if _is_at(path, lock):
            break
        lock.close()  # `all_claimed` has removed it before it was locked here
    lock.truncate(0)
    lock.write(f"{os.getpid()}\n")
    lock.flush()
    return lock


def _is_at(path: Path, lock: IO[str]) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(lock.fileno()))
    except FileNotFoundError:
        return False


@contextmanager
def all_claimed(transport: Transport) -> Iterator[Path]:
    """Hold the locks of all topics and processes, and yield the run directory.

    Its files thus belong to no living process. The locks are removed at the end.
    Raises BusError naming a process that holds one.
    """
    directory = run_directory(transport)
    with ExitStack() as stack:
        for name in (*PROCESSES, *TOPICS):
            stack.enter_context(claim(transport, name))
            stack.callback((directory / f"{name}.lock").unlink, missing_ok=True)  # called while the lock is held
        yield directory


def remove_sockets(directory: Path) -> None:
    """Remove the sockets of all topics from a run directory that is claimed as a whole."""
    for topic in TOPICS:
        for name in (topic, f"{topic}{_BATCHES}"):
            (directory / f"{name}.ipc").unlink(missing_ok=True)


def lock_holders(transport: Transport) -> dict[str, int]:
    """Return by name the ids of processes on this host that hold a lock of theirs, supervised or not."""
    directory = run_directory(transport)
    found: dict[str, int] = {}
    for process in PROCESSES:
        for name in (process, *published_by(process)):
            pid = _holder(directory / f"{name}.lock")
            if pid is not None:
                found[process] = pid
    return found


def _holder(path: Path) -> int | None:
    try:
        lock = open_text(path)
    except FileNotFoundError:
        return None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            text = lock.read().strip()
            return int(text) if text.isdigit() else None
    return None


def remove_stale(transport: Transport) -> list[str]:
    """Remove the sockets of publishers that have ended (killed ones leave them) and return their names."""
    removed = []
    for path in sorted(run_directory(transport).glob("*.ipc")):
        with suppress(BusError, FileNotFoundError), claim(transport, path.stem.removesuffix(_BATCHES)):
            path.unlink()
            removed.append(path.name)
    return removed
