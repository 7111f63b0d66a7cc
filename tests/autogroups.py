"""Whether this system lets a process set the niceness of its session's group."""

from __future__ import annotations

import functools
import subprocess
import sys

#: EAGAIN is no refusal: others have changed a group just now.
_ASK = """
try:
    with open("/proc/self/autogroup", "w") as group:
        group.write("1")
except BlockingIOError:
    pass
"""


@functools.cache
def may_be_set() -> bool:
    """Return it; asked of a process with a session of its own. A sandbox whose /proc is read only refuses it."""
    command = [sys.executable, "-I", "-S", "-c", _ASK]
    return subprocess.run(command, capture_output=True, check=False, start_new_session=True).returncode == 0
