"""Xvfb, Debian's X server without a screen: it ends with whoever started it, however that ends."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence

from tests.with_us import with_us

_SCREEN = ("-screen", "0", "1300x820x24", "-nolisten", "tcp")
_END_S = 20.0


class VirtualDisplay:
    """A server that takes connections once this is made.

    ``-noreset``: by default a server begins anew when its last client leaves, as VTK's first, which only asks whether
    there is a display, does at once; whoever comes meanwhile (one connection in twenty) is refused.

    Parameters
    ----------
    name
        ``":7"``, or empty for a number that is free.
    options
        Of Xvfb, besides the size of the screen.

    Attributes
    ----------
    name : str
        What goes into DISPLAY.
    """

    def __init__(self, name: str = "", options: Sequence[str] = ()) -> None:
        read, write = os.pipe()
        command = ["Xvfb", *([name] if name else []), "-displayfd", str(write), "-noreset", *_SCREEN, *options]
        quiet = subprocess.DEVNULL  # a server that outlived a run would keep its output open
        self._server = subprocess.Popen(with_us(command), pass_fds=[write], stdin=quiet, stdout=quiet, stderr=quiet)
        os.close(write)
        with os.fdopen(read) as ready:
            self.name = f":{ready.readline().strip()}"  # empty where it ended
        if self.name != (name or self.name) or self.name == ":":
            self.end()
            raise RuntimeError(f"Xvfb did not start as display {name or 'of any number'}")

    def end(self) -> None:
        """End it as its user would: it takes its socket and its lock with it. One that does not answer is killed."""
        self._server.terminate()
        try:
            self._server.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._server.kill()
            self._server.wait()
