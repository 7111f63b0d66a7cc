"""Whether this user may take a core from everybody of the ordinary class: root in a container may not always."""

from __future__ import annotations

import functools
import subprocess
import sys

_ASK = "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))"


@functools.cache
def fifo_is_granted() -> bool:
    """Return whether a process of this user may have SCHED_FIFO; asked of one that ends at once."""
    command = [sys.executable, "-I", "-S", "-c", _ASK]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0
