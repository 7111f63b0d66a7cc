"""What a driver finds out about its host: for ``trocar doctor``.

A driver file may have a function ``check_host``. It is called with the settings of all devices of the rig that name it,
and whether a rig is running: then no device may be opened.
"""

from __future__ import annotations

from dataclasses import dataclass


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
