"""Logging and progress of a process as lines on stderr; never from inside a 1 kHz tick."""

from __future__ import annotations

import logging
import sys

#: Prefix of lines on the progress of a long stage of the start: ``PROGRESS <fraction> <stage>``.
PROGRESS = "PROGRESS"


def set_up(process: str) -> logging.Logger:
    """Return the logger of `process`, writing ``process: message`` to stderr."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter(f"{process}: %(levelname)s %(message)s"))
    logger = logging.getLogger(f"trocar.{process}")
    logger.setLevel(logging.INFO)
    logger.handlers[:] = [handler]
    logger.propagate = False
    return logger


def progress(stage: str, fraction: float) -> None:
    """Report the progress of `stage`, 0 to 1."""
    print(f"{PROGRESS} {fraction:.3f} {stage}", file=sys.stderr, flush=True)  # noqa: T201


def parse_progress(line: str) -> tuple[str, float] | None:
    """Return ``(stage, fraction)`` of a progress line, or None for any other line."""
    mark, _, rest = line.partition(" ")
    fraction, _, stage = rest.partition(" ")
    if mark != PROGRESS:
        return None
    try:
        return stage.strip(), float(fraction)
    except ValueError:
        return None
