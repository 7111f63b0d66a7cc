"""Ports of test rigs: not those of another worker of the test run, nor those that the system gives to whoever asks."""

from __future__ import annotations

import os


def base_port(first: int) -> int:
    """Return a rig's ``base_port`` near `first`, which is at most 24,576: topics lie up to 8,192 above it."""
    return first + 10 * int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
