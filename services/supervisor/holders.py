"""Who runs a rig on this host: whoever holds the lock of an endpoint, whether its supervisor lives or not."""

from __future__ import annotations

import fcntl
from pathlib import Path

import protocol
from protocol.topics import published_by
from services.runtime import endpoints
from services.runtime.private_directory import open_text
from services.runtime.rig import Transport


def holders(transport: Transport) -> dict[str, int]:
    """Return by process the id of whoever holds the lock of one of its endpoints."""
    directory = endpoints.run_directory(transport)
    found: dict[str, int] = {}
    for process in protocol.PROCESSES:
        for topic in published_by(process):
            pid = _holder(directory / f"{topic}.lock")
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
