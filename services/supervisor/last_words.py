"""What is said of the lines that a process writes, and of how it ended."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from pathlib import Path

from services.supervisor.member import Member


def level_of(line: str, name: str) -> str:
    """Return how loud a line is: only warnings are. What libraries print and last words stay in the log file."""
    loud = line.startswith((f"{name}: WARNING", f"{name}: ERROR", f"{name}: CRITICAL"))
    return "warning" if loud else "debug"


def how_it_ended(status: int, lines: Sequence[str]) -> str:
    """Return how a process ended, with its last line where it had one and failed."""
    if status < 0:
        return f"ended by {signal.Signals(-status).name}"
    last = f": {lines[-1]}" if status > 0 and lines else ""
    return f"ended with exit code {status}{last}"


def start_sentence(member: Member, status: int, log_file: Path) -> str:
    """Return what a person is told of a process that ended while starting: its own sentence where it had one."""
    last = member.last_lines[-1] if member.last_lines else "it said nothing"
    if last.startswith(f"{member.name}: ") and not any(line.startswith("Traceback") for line in member.last_lines):
        return last
    return f"{member.name} ended with exit code {status} while starting: {last} (see {log_file})"
