"""The kernel's automatic groups: where they are on, a niceness is heard only within a session.

All ordinary processes of a session share what one process of another session may have (`sched(7)`, "The autogroup
feature"): a page at niceness -10 waited for half of the time on a machine with ten busy sessions. So each process of
the rig is the leader of a session, and its group has its niceness. Containers have groups of their own instead
(`cpu_shares` in the compose file).
"""

from __future__ import annotations

import ctypes
import os
import signal
import time
from contextlib import suppress
from pathlib import Path

_OURS = Path("/proc/self/autogroup")
#: Who is no administrator may change a group ten times a second, all of them together.
_TRIES, _APART_S = 10, 0.1
_PR_SET_PDEATHSIG = 1


def set_group_niceness(niceness: int, path: Path = _OURS) -> bool:
    """Give the group of this process' session a niceness; return whether it has it.

    Of a session that others began nothing is changed: it is that of a person's terminal.
    """
    if os.getsid(0) != os.getpid():
        return False
    with suppress(OSError):  # no such groups, or no right to a niceness below 0
        if path.read_text().split()[-1:] == [str(niceness)]:
            return True  # to write it would hold up everybody who has something to change
        for _ in range(_TRIES):
            try:
                path.write_text(str(niceness))
            except BlockingIOError:
                time.sleep(_APART_S)
            else:
                return True
    return False


def end_with_parent() -> None:
    """Let the kernel end this process when the thread that started it ends, by whatever end.

    Helpers of a process are ended with its group; one that leads a session of its own is in none but its own.
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
