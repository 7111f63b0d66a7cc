"""Checks of the host by drivers, for ``trocar doctor``.

A driver file may have a function ``check_host``. It is called with the settings of all the rig's devices of this
driver, and whether a rig is running, during which no device may be opened.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class HostCheck:
    """One finding.

    Attributes:
        advice: str. What to do if it is not `ok`.
        needed: bool. Whether the rig cannot run without it.
    """

    name: str
    ok: bool
    found: str
    advice: str
    needed: bool = False


def text_of(file: Path) -> str:
    """Return the content of a file of ``/sys``, empty without it."""
    return file.read_text(errors="replace").strip() if file.is_file() else ""
