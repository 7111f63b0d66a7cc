"""Checks whether a loop that is to run interrupts the kernel while it works for an ordinary process.

A kernel without preemption ends the system call first: a process of the machine that made one of 1.4 ms a second was
behind two thirds of the moments in which a rig missed ticks, whatever the loops' priority
(docs/explanation/fast-path.md).
"""

from __future__ import annotations

import gzip
import platform
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

_CHOSEN = Path("/sys/kernel/debug/sched/preempt")
_COMMAND_LINE = Path("/proc/cmdline")
_REALTIME = "rt"
#: Of these a thread with a real-time priority need not wait for a system call to end.
_AT_ONCE = ("full", "lazy", _REALTIME)
_OPTIONS = {"PREEMPT_NONE": "none", "PREEMPT_VOLUNTARY": "voluntary", "PREEMPT": "full", "PREEMPT_LAZY": "lazy"}


def model(version: str, command_line: str = "", config: str = "", chosen: str = "") -> str:
    """Return how the kernel preempts: none, voluntary, full, lazy or rt; empty where nobody tells.

    Args:
        version: As `platform.version` has it.
        command_line: What the kernel was started with.
        config: What it was built with: lines as ``CONFIG_PREEMPT_NONE=y``.
        chosen: What it says itself, where it may be asked: all of them, one in brackets.
    """
    if "PREEMPT_RT" in version:
        return _REALTIME
    if "PREEMPT_DYNAMIC" not in version:
        return "full" if "PREEMPT" in version else "none"
    asked = re.search(r"\((\w+)\)", chosen) or re.search(r"(?:^|\s)preempt=(\w+)", command_line)
    if asked:
        return asked[1]
    built = re.search(rf"^CONFIG_({'|'.join(_OPTIONS)})=y$", config, re.MULTILINE)
    return _OPTIONS[built[1]] if built else ""


def is_prompt(how: str) -> bool:
    """Return whether a loop gets its core at once; who does not tell is trusted."""
    return how in ("", *_AT_ONCE)


def of_this_kernel() -> str:
    """Return the `model` of the kernel that runs."""
    chosen, command_line = _text(_CHOSEN), _text(_COMMAND_LINE)
    return model(platform.version(), command_line, next(filter(None, _configs()), ""), chosen)


def _configs() -> Iterator[str]:
    with suppress(OSError), gzip.open("/proc/config.gz", "rt") as file:
        yield file.read()
    yield _text(Path(f"/boot/config-{platform.release()}"))


def _text(path: Path) -> str:
    with suppress(OSError):
        return path.read_text()
    return ""
