"""What is said of the lines that a process writes, and of how it ended."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from pathlib import Path

from services.supervisor.member import Member

#: Bytes that the words, sockets, locks and last ticks of a rig take at most.
_ROOM = 1 << 20
_LEVELS = ("DEBUG", "INFO", "WARNING", "ERROR", "CRITICAL")


def level_of(line: str, name: str) -> str:
    """Return how loud a line is: only warnings are. What libraries print and last words stay in the log file."""
    loud = line.startswith((f"{name}: WARNING", f"{name}: ERROR", f"{name}: CRITICAL"))
    return "warning" if loud else "debug"


def _is_sentence(line: str, name: str) -> bool:
    """Return whether a line is what a process says when it gives up, and none of its log."""
    mark, _, rest = line.partition(": ")
    return mark == name and rest.partition(" ")[0] not in _LEVELS


def how_it_ended(status: int, lines: Sequence[str]) -> str:
    """Return how a process ended, with its last line where it had one and failed."""
    if status < 0:
        return f"ended by {signal.Signals(-status).name}"
    last = f": {lines[-1]}" if status > 0 and lines else ""
    return f"ended with exit code {status}{last}"


def start_sentence(member: Member, status: int, log_file: Path) -> str:
    """Return what a person is told of a process that ended while starting: its own sentence where it had one."""
    lines = list(member.last_lines)
    own = [line for line in lines if _is_sentence(line, member.name)]
    if own and not any(line.startswith("Traceback") for line in lines):
        return own[-1]  # a library may have had a word after it
    last = lines[-1] if lines else f"it said nothing{_for_want_of_room(log_file.parent)}"
    return f"{member.name} ended with exit code {status} while starting: {last} (see {log_file})"


def _for_want_of_room(directory: Path) -> str:
    """Return that a disk is full where it is: what a process says, its sockets and its locks are there."""
    found = os.statvfs(directory)
    free = found.f_bavail * found.f_frsize
    return f", and {directory} has {free >> 10} kB left" if free < _ROOM else ""
