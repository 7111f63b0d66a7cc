"""While a process of the rig imports, nothing is garbage: to look for it takes a seventh of the time."""

from __future__ import annotations

import gc
import sys


def begin() -> None:
    """Switch the garbage collector off where ``python -m services.NAME`` begins; `end` switches it on again."""
    if sys.argv[:1] == ["-m"] and _names_a_process(sys.orig_argv):
        gc.disable()


def end() -> None:
    """Switch it on again; what was imported lives as long as the process, and is never looked at."""
    gc.freeze()
    gc.enable()


def _names_a_process(arguments: list[str]) -> bool:
    """Whether Python was asked for a folder of `services`: each of those calls `end`."""
    if "-m" not in arguments[:-1]:
        return False
    package, *names = arguments[arguments.index("-m") + 1].split(".")
    return package == "services" and len(names) == 1
