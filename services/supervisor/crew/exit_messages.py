"""Messages about a process' output and its end."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from pathlib import Path

from trocar.services.supervisor.crew.member import Member

#: A rig's logs, sockets, locks and flight rings take less than this, so that with more the disk was not at fault.
_ROOM = 1 << 20
_LEVELS = ("DEBUG", "INFO", "WARNING", "ERROR", "CRITICAL")


def level_of(line: str, name: str) -> str:
    """Return the level of a line: warnings of the process itself are shown, all others stay in the log file."""
    loud = line.startswith((f"{name}: WARNING", f"{name}: ERROR", f"{name}: CRITICAL"))
    return "warning" if loud else "debug"


def _is_sentence(line: str, name: str) -> bool:
    """Return whether a line is a process' final error message, and not a line of its log."""
    mark, _, rest = line.partition(": ")
    return mark == name and rest.partition(" ")[0] not in _LEVELS


def how_it_ended(status: int, lines: Sequence[str]) -> str:
    """Return how a process ended, with its last line if it failed."""
    if status < 0:
        return f"ended by {signal.Signals(-status).name}"
    last = f": {lines[-1]}" if status > 0 and lines else ""
    return f"ended with exit code {status}{last}"


def start_sentence(member: Member, status: int, log_file: Path) -> str:
    """Return the message about a process that ended while starting, its own if it wrote one."""
    lines = list(member.last_lines)
    own = [line for line in lines if _is_sentence(line, member.name)]
    if own and not any(line.startswith("Traceback") for line in lines):
        return own[-1]  # libraries may write lines after it
    last = lines[-1] if lines else f"it said nothing{_disk_full_note(log_file.parent)}"
    return f"{member.name} ended with exit code {status} while starting: {last} (see {log_file})"


def _disk_full_note(directory: Path) -> str:
    """Return a note if the disk of `directory`, with logs, sockets and locks, is full; else empty."""
    found = os.statvfs(directory)
    free = found.f_bavail * found.f_frsize
    return f", and {directory} has {free >> 10} kB left" if free < _ROOM else ""
