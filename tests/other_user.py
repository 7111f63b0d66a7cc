"""Another user of the machine, as tests need one: a process without any right of ours. Takes root, which CI is."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

NOBODY = 65534
_SETPRIV = ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"]


def _missing() -> str:
    """Return what another user lacks here, empty if one can be acted."""
    if os.geteuid() != 0 or shutil.which("setpriv") is None:
        return "only root can act as another user, with setpriv"
    tried = subprocess.run([*_SETPRIV, sys.executable, "-c", ""], capture_output=True, check=False, cwd="/")
    return f"another user cannot run {sys.executable}" if tried.returncode else ""


_lacks = _missing()
needs_other_user = pytest.mark.skipif(bool(_lacks), reason=_lacks or "nothing is missing")


def as_other_user(program: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a Python program of the standard library as another user."""
    command = [*_SETPRIV, sys.executable, "-I", "-S", "-c", program, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, cwd="/")


@contextmanager
def folder_of_everybody() -> Iterator[Path]:
    """Make a folder like ``/tmp``: everybody may make files in it, and remove nobody else's."""
    with tempfile.TemporaryDirectory(dir="/tmp") as name:
        folder = Path(name)
        folder.chmod(0o1777)
        yield folder


@pytest.fixture
def everybodys() -> Iterator[Path]:
    """Return a folder of everybody."""
    with folder_of_everybody() as folder:
        yield folder
