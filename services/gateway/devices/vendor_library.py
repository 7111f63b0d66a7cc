"""A vendor's C library: loaded with the types of its functions, and tried in a process of its own."""

from __future__ import annotations

import ctypes
import subprocess
import sys
from collections.abc import Iterable, Mapping
from typing import Any

Signatures = Mapping[str, tuple[Any, tuple[Any, ...]]]
#: After so long a vendor's library is taken to hang: opening a device takes it some seconds. An assumption.
PATIENCE_S = 20.0
#: Ticks between looks whether this process has become real-time, which happens when its loop begins, so that a
#: library's thread becomes it, too. A look is a system call; the hand has no force yet while it is a sixtieth of a
#: second late.
RAISE_EVERY = 16


def load_library(names: Iterable[str]) -> ctypes.CDLL:
    """Return the first of the libraries that can be loaded. Raises the OSError of the first name, if none can."""
    first: OSError | None = None
    for name in names:
        try:
            return ctypes.CDLL(name)
        except OSError as error:
            first = first or error
    raise first or OSError("no name of it is known")


def declare_functions(library: ctypes.CDLL, signatures: Signatures) -> None:
    """Give functions their result and argument types. Raises AttributeError for one that the library lacks."""
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments


def run_apart(module: str, *arguments: str) -> tuple[int, str]:
    """Run a module that uses the library, which may crash or hang; return its exit code and the last line it said."""
    command = [sys.executable, "-m", module, *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    except subprocess.TimeoutExpired:
        return 1, f"no answer within {PATIENCE_S:.0f} s"
    if done.returncode < 0:
        return 1, f"ends with signal {-done.returncode}"
    return done.returncode, (done.stdout.strip() or done.stderr.strip() or "?").splitlines()[-1]
