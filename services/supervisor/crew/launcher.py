"""Starts a process and monitors it: its end, whether it is stopped, and its output.

A child writes to a file, not to a pipe, so that a stopped or dead supervisor neither blocks it (a full pipe would stall
a 1 kHz loop at its next warning) nor breaks its writes.
"""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
from collections.abc import Collection, Sequence
from contextlib import suppress
from pathlib import Path

from trocar.services.runtime.private_directory import open_private
from trocar.services.supervisor.crew.processes import ProcessSpec
from trocar.services.supervisor.crew.scheduler_state import SchedulerState, Waits

#: Longest line kept, to bound the memory for a child's output.
_LINE_MAX = 2000
#: Read of a child's log in one turn of 20 ms, so that one that writes without end (beyond 3 MB/s) does not delay the
#: others: what is left stays in the file.
_READ_BYTES = 1 << 16
#: Colour codes of some libraries' output.
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")


def _start(spec: ProcessSpec, arguments: Sequence[str], log_file: Path, pass_fds: Collection[int]) -> int:
    """Start a process in a session of its own and return its id."""
    with os.fdopen(open_private(log_file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), "wb") as sink:
        popen = subprocess.Popen(
            [sys.executable, "-m", spec.module, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=sink,
            stderr=sink,
            env={**os.environ, **spec.environment},
            pass_fds=pass_fds,
            # A Ctrl-C at the terminal is only for us, as children are ended in order; also for
            # `trocar.services.runtime.realtime.autogroup`.
            start_new_session=True,
        )
    popen.returncode = 0  # `Child.end` waits for it
    return popen.pid


class Child:
    """A process, started here unless it is a fork already; its descriptor becomes readable when it ends."""

    def __init__(
        self,
        spec: ProcessSpec,
        arguments: Sequence[str],
        log_file: Path,
        pass_fds: Collection[int] = (),
        forked: int = 0,
    ) -> None:
        self.pid = forked or _start(spec, arguments, log_file, pass_fds)
        self.log_file = log_file
        self._status: int | None = None
        self.descriptor = os.pidfd_open(self.pid)
        self._kernel = SchedulerState(self.pid)
        self._log = os.fdopen(open_private(log_file, os.O_RDONLY), "rb")
        self._rest = b""

    def end(self) -> int | None:
        """Return the exit status once the process has ended (negative: the signal), and end its own children."""
        if self._status is None:
            if os.waitid(os.P_PIDFD, self.descriptor, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
                return None
            # It is still a zombie, so its group id is not reused: helpers that it left behind are ended with it.
            with suppress(ProcessLookupError):
                os.killpg(self.pid, signal.SIGKILL)
            self._status = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return self._status

    def wait(self, timeout_s: float) -> int | None:
        """Return the exit status once the process has ended, None if it has not within `timeout_s`."""
        select.select([self.descriptor], [], [], timeout_s)
        return self.end()

    def kill(self) -> int:
        """Kill the process and return its exit status."""
        self.send(signal.SIGKILL)
        while (status := self.wait(1.0)) is None:
            pass
        return status

    def is_stopped(self) -> bool:
        """Return whether a signal or a debugger stops the process (SIGSTOP)."""
        return self._kernel.is_stopped()

    def waits(self) -> Waits:
        """Return the waits of its loop and its bus for a processor since their start, 0 if unknown."""
        return self._kernel.waits()

    def send(self, number: signal.Signals) -> None:
        """Send a signal, without effect on a process that has ended."""
        if self.end() is None:
            signal.pidfd_send_signal(self.descriptor, number)

    def lines(self) -> list[str]:
        """Return the complete lines since the last call, and all output once the process has ended."""
        data = self._rest + self._log.read(_READ_BYTES)
        *whole, self._rest = data.split(b"\n")
        if self._status is not None or len(self._rest) > _LINE_MAX:
            whole.append(self._rest)
            self._rest = b""
        texts = (_COLOURS.sub("", line[:_LINE_MAX].decode("utf-8", "replace")).rstrip() for line in whole)
        return [text for text in texts if text]

    def close(self) -> None:
        """Close the descriptors of a process that has ended."""
        os.close(self.descriptor)
        self._kernel.close()
        self._log.close()
