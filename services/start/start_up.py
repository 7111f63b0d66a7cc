"""While a process of the rig imports, nothing is garbage: to look for it takes a seventh of the time.

While it builds and compiles, what is garbage has died young: to look through all that lives took 7 s of the 77 in which
physics compiles from nothing.
"""

from __future__ import annotations

import gc
import sys

#: New objects until the youngest are looked through, how often until those that survived are, and these until all are.
_THRESHOLDS = 200_000, 10, 1_000_000
_PYTHONS = gc.get_threshold()


def begin() -> None:
    """Switch the garbage collector off where ``python -m trocar.services.NAME`` begins; `end` switches it on again."""
    if sys.argv[:1] == ["-m"] and _names_a_process(sys.orig_argv):
        gc.disable()


def end() -> None:
    """Switch it on again, for what dies young; what was imported lives with the process, and is never looked at."""
    gc.freeze()
    gc.set_threshold(*_THRESHOLDS)
    gc.enable()


def over() -> None:
    """Look for garbage as Python does: to look through 200,000 objects takes 50 ms, in which a loop stands still."""
    gc.set_threshold(*_PYTHONS)


def _names_a_process(arguments: list[str]) -> bool:
    """Whether Python was asked for a folder of `services`: each of those calls `end`."""
    if "-m" not in arguments[:-1]:
        return False
    package, _, name = arguments[arguments.index("-m") + 1].rpartition(".")
    return package == "trocar.services" and bool(name)
