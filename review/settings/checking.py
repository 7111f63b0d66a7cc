"""Checks in processes of their own, as they need much that a server has no use for."""

from __future__ import annotations

import subprocess
import sys

from trocar.services.runtime.errors import UserError

_PATIENCE_S = 120.0  # assumption: the first check of a new scene makes its mesh, which takes less


def run_check(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run ``python -m`` with arguments to its end. Raises UserError if it takes too long."""
    command = [sys.executable, "-m", *arguments]
    try:
        return subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=_PATIENCE_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise UserError(f"the check has not ended within {_PATIENCE_S:.0f} s") from None


def last_line(told: str) -> str:
    """Return the sentence that a check ends with, empty for none."""
    return "".join(told.strip().splitlines()[-1:])
