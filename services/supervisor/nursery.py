"""Where processes of the rig are born: as copies of one that has imported what they import (`zygote`).

Importing is most of a warm start, and of the time for which a process that died is away. The supervisor itself is no
process to copy: it has threads, locked memory and a real-time class.
"""

from __future__ import annotations

import ctypes
import os
import resource
import socket
import subprocess
import sys
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import msgspec

from services.runtime.errors import UserError
from services.supervisor.kernel_word import KernelWord
from services.supervisor.processes import ENVIRONMENT, ProcessSpec
from services.supervisor.zygote import READY, Order

_PR_SET_CHILD_SUBREAPER = 36
#: A command line of a process is written over the zygote's: so much room there is for one.
_ROOM = " " * 4000
#: Names of variables begin so that are read when a process starts, and never again.
_READ_AT_START = ("PYTHON", *ENVIRONMENT)
#: Who is not ready, or has not answered, after so long is given up: processes are then started without it.
_PATIENCE_S = 10.0
#: It is looked at so often whether a signal holds it; one that is gone is started again so often.
_LOOK_S, _RETRIES = 1.0, 5
#: Files that a process of a rig has open at once, at most; the supervisor had 98 with a rig that ran.
_FILES = 256


@dataclass(slots=True)
class Birth:
    """A process that was asked for: `pid` is None until it is born, -1 if it will not be."""

    asked_s: float
    pid: int | None = None


class Nursery:
    """Runs a zygote while it is open. Nothing in it waits.

    Attributes
    ----------
    ready : bool
        Whether the zygote has imported what it imports.
    lost : bool
        Whether it is gone: who is asked for now will not be born.

    Raises
    ------
    UserError
        if this process may not open as many files as a rig needs.
    """

    def __init__(self) -> None:
        _make_room()
        self._asked: deque[Birth] = deque()
        self._starts = 0
        self._closed = False
        self._begin()

    def _begin(self) -> None:
        self._starts += 1
        self._link, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._link.setblocking(False)
        self._environment = {**os.environ, **ENVIRONMENT}
        self._zygote = subprocess.Popen(
            [sys.executable, "-m", "services.supervisor.zygote", str(other.fileno()), _ROOM],
            stdin=subprocess.DEVNULL,
            env=self._environment,
            pass_fds=(other.fileno(),),
            start_new_session=True,  # as of those it bears: a Ctrl-C at the terminal is the supervisor's
        )
        other.close()
        self._began_s = time.monotonic()
        self._kernel = KernelWord(self._zygote.pid)
        self._looked_s = self._began_s
        self.ready = self.lost = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the zygote for good; who was asked for and is not born will not be."""
        self._closed = True
        self._lose()

    def revive(self) -> bool:
        """Start a zygote in place of one that is gone; return whether one was started."""
        if self._closed or not self.lost or self._starts > _RETRIES:
            return False
        self._begin()
        return True

    def _lose(self) -> None:
        if not self.lost:
            self._kernel.close()
        self.lost = True
        self._link.close()
        with suppress(ProcessLookupError):
            self._zygote.kill()
        self._zygote.wait()
        while self._asked:
            self._asked.popleft().pid = -1
        _adopt_orphans(False)

    @property
    def descriptor(self) -> int:
        """What becomes readable when there is something to `hear`; -1 if there never will be."""
        return self._link.fileno()

    @property
    def pid(self) -> int:
        """Process id of the zygote."""
        return self._zygote.pid

    def bears(self, spec: ProcessSpec) -> bool:
        """Return whether it can bear such a process: what Python and libraries read at their start is the zygote's."""
        read = ((name, value) for name, value in spec.environment.items() if name.startswith(_READ_AT_START))
        return not self.lost and all(self._environment.get(name) == value for name, value in read)

    def ask(self, spec: ProcessSpec, arguments: Sequence[str], sink: int) -> Birth:
        """Ask for a process that writes into the file `sink`; it is a child of this one as soon as it is told of."""
        birth = Birth(time.monotonic())
        order = msgspec.json.encode(Order(spec.module, tuple(arguments), dict(spec.environment)))
        self._asked.append(birth)
        _adopt_orphans(True)
        try:
            socket.send_fds(self._link, [order], [sink])
        except OSError:  # it is gone
            self._lose()
        return birth

    def hear(self) -> None:
        """Take what the zygote has said; give it up where it has not, for long."""
        while not self.lost:
            try:
                said = self._link.recv(64)
            except BlockingIOError:
                break
            except OSError:
                said = b""
            self._take(said)
        since_s = self._asked[0].asked_s if self._asked else self._began_s
        now_s, is_held = time.monotonic(), False
        if not self.lost and now_s - self._looked_s > _LOOK_S:
            self._looked_s, is_held = now_s, self._kernel.is_stopped()
        if is_held or ((self._asked or not self.ready) and now_s - since_s > _PATIENCE_S):
            self._lose()

    def _take(self, said: bytes) -> None:
        if not said:
            self._lose()
        elif said == READY:
            self.ready = True
        else:
            self._asked.popleft().pid = int(said)
            _adopt_orphans(bool(self._asked))


def _adopt_orphans(yes: bool) -> None:
    """Let orphans of this process' children become its own, while one is to be born; else they are the system's."""
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, int(yes), 0, 0, 0)


def _make_room() -> None:
    """Raise the limit of open files as far as is needed, beside those that whoever started us has left open."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = _FILES + len(os.listdir("/proc/self/fd"))
    if soft >= needed or soft == resource.RLIM_INFINITY:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        raise UserError(f"only {hard} files may be open at once, a rig needs {needed}: `ulimit -n {needed}` allows it")
    resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))
