"""Processes that begin with modules imported: forks of one that has done nothing else.

A process that imports numba and the mechanics takes two seconds of processor before it says a word. What is asked of a
process of its own because of what it compiles, or reads from disk, is asked of a fork as well: nothing has been
compiled before it.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

#: Forks for each line. Between it and each fork stands one that tells how that ended; the fork ends as any process.
_SERVER = """
import json, os, sys
exec(sys.argv[1])
running = 0
print("ready", flush=True)
while line := sys.stdin.readline():
    order = json.loads(line)
    if os.fork():
        while running and os.waitpid(-1, os.WNOHANG)[0]:
            running -= 1
        running += 1
        continue
    if child := os.fork():
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        with open(order["said"] + ".half", "w") as file:
            file.write(str(status))
        os.rename(order["said"] + ".half", order["said"] + ".status")
        os._exit(0)
    for number, name in enumerate((os.devnull, order["said"] + ".out", order["said"] + ".err")):
        os.dup2(os.open(name, os.O_RDWR | os.O_CREAT, 0o600), number)
    os.environ.clear()
    os.environ.update(order["environment"])
    os.chdir(order["folder"])
    sys.path[0] = order["folder"]
    sys.argv[1:] = order["arguments"]
    break
while not line and running:
    os.wait()
    running -= 1
if line:
    exec(compile(order["code"], "<order>", "exec"), {"__name__": "__main__"})
"""


@dataclass(frozen=True)
class Running:
    """A fork that runs, or has ended."""

    said: Path

    def wait(self) -> subprocess.CompletedProcess[str]:
        """Return how it ended and what it said."""
        status = self.said.with_suffix(".status")
        while not status.exists():  # for as long as the test may take
            time.sleep(0.005)
        out, err = (self.said.with_suffix(suffix).read_text() for suffix in (".out", ".err"))
        return subprocess.CompletedProcess(self.said, int(status.read_text()), out, err)


class Preloaded:
    """The process that has run `code`, which imports, and forks, while a ``with`` block lasts; `folder` is its own."""

    def __init__(self, folder: Path, code: str) -> None:
        self._folder, self._code, self._count = folder, code, 0

    def __enter__(self) -> Self:
        command = [sys.executable, "-c", _SERVER, self._code]
        self._server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)
        assert self._server.stdout is not None
        assert self._server.stdout.readline() == "ready\n"
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _value: BaseException | None, _trace: TracebackType | None
    ) -> None:
        with self._server:
            assert self._server.stdin is not None
            self._server.stdin.close()

    def start(self, code: str, arguments: Sequence[str], folder: Path, environment: Mapping[str, str]) -> Running:
        """Run code in a fork, in a folder, which is first in its path, with all of an environment."""
        self._count += 1
        said = self._folder / f"fork{self._count}"
        order = {"code": code, "arguments": list(arguments), "folder": str(folder), "environment": dict(environment)}
        assert self._server.stdin is not None
        self._server.stdin.write(json.dumps(order | {"said": str(said)}) + "\n")
        return Running(said)
