"""Dependencies of a simulation's numbers besides scene and hands: sources of the mechanics, and machine."""

from __future__ import annotations

import hashlib
import platform
from functools import cache
from importlib.metadata import version
from pathlib import Path

from trocar.services.runtime.realtime.machine import processor_name

#: Packages that determine the result of a step.
_PACKAGES = ("mechanics", "physics", "haptics")
_LIBRARIES = ("numpy", "scipy", "numba", "llvmlite")


@cache
def mechanics_digest() -> str:
    """Return a hash of the sources of mechanics, physics and haptics."""
    services = Path(__file__).parents[1]
    text = hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted((services / package).rglob("*.py")):
            text.update(str(path.relative_to(services)).encode() + b"\0" + path.read_bytes())
    return text.hexdigest()


def machine() -> str:
    """Return the kind of this machine: processor and libraries. On another kind the last bits may differ."""
    libraries = ", ".join(f"{name} {version(name)}" for name in _LIBRARIES)
    python = ".".join(platform.python_version_tuple()[:2])
    return f"{processor_name()}, Python {python}, {libraries}"
