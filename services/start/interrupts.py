"""Ctrl-C while a command is not at work yet, or no more: it ends with the code for that, and says nothing.

Python turns the signal into a KeyboardInterrupt wherever it happens to be. Within an import, or in what Python itself
does at its end, that is a traceback of which nobody needs a line. `Raised` puts the exception back for as long as there
is somebody to catch it. The module imports little, because it is what comes first.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys

#: `ExitCode.INTERRUPTED`, as shells have it: 128 and, for SIGINT, 2.
_CODE = 130
#: Filled where a command has ended by Ctrl-C.
_interrupted: list[bool] = []


def begin() -> None:
    """Let Ctrl-C end this process at once, if it was started as a command or a module of Trocar.

    A shell's job in the background, which ignores Ctrl-C, goes on ignoring it.
    """
    if _is_ours(sys.orig_argv) and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
        atexit.register(_keep_code)  # as the first one, so that it is called last


def end() -> None:
    """End a command that Ctrl-C has interrupted.

    Python remembers an interruption that has passed through `exec` of a text, as imports of scipy do, and then ends by
    the signal, whatever code it is given: so the code is kept until all else is done.
    """
    _interrupted.append(True)
    sys.exit(_CODE)


class Raised:
    """Context in which Ctrl-C raises KeyboardInterrupt."""

    def __enter__(self) -> None:
        self._is_turned = signal.getsignal(signal.SIGINT) is _leave
        if self._is_turned:
            signal.signal(signal.SIGINT, signal.default_int_handler)

    def __exit__(self, *_: object) -> None:
        if self._is_turned:
            signal.signal(signal.SIGINT, _leave)


def _keep_code() -> None:
    if _interrupted:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(_CODE)


def _leave(_number: int, _frame: object) -> None:
    os._exit(_CODE)


def _is_ours(arguments: list[str]) -> bool:
    """Return whether Python was started with ``-m trocar...``, or with the script of the command `trocar`."""
    words = arguments[1:]
    for before, word in zip(["", *words], words, strict=False):
        if before == "-m":
            return word.partition(".")[0] == "trocar"
        if not word.startswith("-") and before not in ("-X", "-W"):
            return os.path.basename(word) in ("trocar", "trocar.exe")
    return False
