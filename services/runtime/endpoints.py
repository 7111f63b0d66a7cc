"""Where a topic is bound: derived from its name and the rig's transport, held by a lock.

A second bind on an ipc path succeeds and silently steals it, so whoever publishes holds an exclusive lock on
``<endpoint>.lock`` for as long as it lives; the kernel releases it when the process dies, however it dies.
"""

from __future__ import annotations

import fcntl
import os
import zlib
from pathlib import Path
from typing import IO

from services.runtime.errors import BusError
from services.runtime.rig import Transport

_MAX_IPC_PATH = 107
_PORTS = 8192


def run_directory(transport: Transport) -> Path:
    """Return the directory of the rig's sockets and locks, made private to this user."""
    directory = transport.directory
    if directory is None:
        directory = Path(os.environ.get("XDG_RUNTIME_DIR") or "/tmp") / f"trocar-{os.getuid()}"
    directory.mkdir(parents=True, exist_ok=True, mode=0o700)
    return directory


def endpoint(transport: Transport, topic: str, host: str | None = None) -> str:
    """Return the ZeroMQ endpoint of `topic`; for tcp at `host`, by default the publisher's of the rig file.

    Raises
    ------
    BusError
        if an ipc path would be longer than the system allows.
    """
    if transport.kind == "tcp":
        port = transport.base_port + zlib.crc32(topic.encode()) % _PORTS
        publisher = topic.split(".")[0]
        return f"tcp://{host or transport.hosts.get(publisher, transport.host)}:{port}"
    path = str(run_directory(transport) / f"{topic}.ipc")
    if len(path) > _MAX_IPC_PATH:
        raise BusError(f"transport.directory: the socket path {path} has {len(path)} characters, the system allows 107")
    return f"ipc://{path}"


def claim(transport: Transport, topic: str) -> IO[str]:
    """Take the lock of `topic`'s endpoint and return it; closing it, or dying, gives it up.

    Raises
    ------
    BusError
        naming the process that has it.
    """
    path = run_directory(transport) / f"{topic}.lock"
    lock = path.open("a+")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.seek(0)
        holder = lock.read().strip() or "unknown"
        lock.close()
        raise BusError(f"topic {topic} is already published by process {holder} (lock {path})") from None
    lock.truncate(0)
    lock.write(f"{os.getpid()}\n")
    lock.flush()
    return lock
