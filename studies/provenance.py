"""Which code ran."""

from __future__ import annotations

import subprocess
from importlib.metadata import version
from pathlib import Path


def code_version(root: Path) -> str:
    """Name the code that ran: the commit of the checkout, with a mark where it has been edited, else the package."""
    try:
        told = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=10"],
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return f"trocar {version('trocar')}"
    return told.stdout.strip()
