"""Processes that end with the tests which started them, also where these are killed.

A rig that is left over keeps its cores in real time: whatever runs next on the machine is starved by it.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence


def with_us(command: Sequence[str]) -> list[str]:
    """Return the command whose process is asked to end (SIGTERM) when this one is gone; it has its own pid and name."""
    asked = ["setpriv", "--pdeathsig", "TERM"] if shutil.which("setpriv") else []  # of util-linux
    return [*asked, *command]
