"""What a driver finds out about its host: for ``trocar doctor``.

A driver file may have a function ``check_host``. It is called with the settings of all devices of the rig that name it,
and whether a rig is running: then no device may be opened.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class HostCheck:
    """One finding.

    Attributes:
        advice: str. What to do where it is not `ok`.
        needed: bool. Whether the rig cannot run without it.
    """

    name: str
    ok: bool
    found: str
    advice: str
    needed: bool = False


def text_of(file: Path) -> str:
    """Return what the kernel says in a file of ``/sys``, empty where there is none."""
    return file.read_text(errors="replace").strip() if file.is_file() else ""
