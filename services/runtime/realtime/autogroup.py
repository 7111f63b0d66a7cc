"""The kernel's automatic groups: where they are enabled, a niceness only acts within a session.

All ordinary processes of a session together get the share of one process of another session (`sched(7)`, "The autogroup
feature"): a page at niceness -10 waited for half of the time on a machine with ten busy sessions. So each process of
the rig leads a session, whose group has its niceness. Containers have groups of their own instead (`cpu_shares` in the
compose file).
"""

from __future__ import annotations

import ctypes
import os
import signal
import time
from contextlib import suppress
from pathlib import Path

_OURS = Path("/proc/self/autogroup")
#: Ordinary users can change groups ten times a second, all of them together.
_TRIES, _APART_S = 10, 0.1
_PR_SET_PDEATHSIG = 1  # Linux: <linux/prctl.h>


def set_group_niceness(niceness: int, path: Path = _OURS) -> bool:
    """Set the niceness of the group of this process' session; return whether it has it.

    A session started by another process, such as a person's terminal, is not changed.
    """
    if os.getsid(0) != os.getpid():
        return False
    with suppress(OSError):  # no such groups, or no permission for a niceness below 0
        if path.read_text().split()[-1:] == [str(niceness)]:
            return True  # a write would use up the limit for others
        for _ in range(_TRIES):
            try:
                path.write_text(str(niceness))
            except BlockingIOError:
                time.sleep(_APART_S)
            else:
                return True
    return False


def end_with_parent() -> None:
    """Let the kernel end this process when the thread that started it ends, for any reason.

    Helpers of a process are ended with its group, except one that leads a session of its own.
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
