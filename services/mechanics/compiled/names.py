"""Symbols that no other process has given: code that several processes have compiled ends up in one.

numba tells functions of one name and of the same argument types apart, closures above all, its own among them, by a
number that counts up in each process. Code on disk keeps these names, so a process that read it from two found two
bodies under one name, and whoever was linked second called the first one's function, without a word. Where numbers
begin is therefore drawn, from 2^62.
"""

from __future__ import annotations

import itertools
import os
import secrets

from numba.core.bytecode import FunctionIdentity

_COUNTER = "_unique_ids"


def begin() -> None:
    """Let numba count from a number of this process' own, in its children too."""
    _draw()
    os.register_at_fork(after_in_child=_draw)


def _draw() -> None:
    setattr(FunctionIdentity, _COUNTER, itertools.count(secrets.randbits(62)))
