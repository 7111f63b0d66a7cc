"""Log lines: a process of the rig writes them to standard error; never from inside a 1 kHz tick."""

from __future__ import annotations

import logging
import os
import sys

from trocar.services.messages.nearest_word import did_you_mean
from trocar.services.runtime.errors import ConfigError

#: Prefix of lines on the progress of a long stage of the start: ``PROGRESS <fraction> <stage>``.
PROGRESS = "PROGRESS"
#: Names the level for a process and all that it starts.
LEVEL_VARIABLE = "TROCAR_LOG_LEVEL"
LEVELS = {"debug": logging.DEBUG, "info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}


def level_of(name: str, where: str) -> int:
    """Return the number of a level. Raises ConfigError that begins with `where` and lists those that there are."""
    if name not in LEVELS:
        near = did_you_mean(name, LEVELS)
        raise ConfigError(f"{where}: there is no level {name!r}; known: {', '.join(LEVELS)}{near}")
    return LEVELS[name]


def asked_level() -> int | None:
    """Return the level that this process was started with, None if nobody named one.

    Raises ConfigError if the variable names none that there is.
    """
    named = os.environ.get(LEVEL_VARIABLE)
    return level_of(named, LEVEL_VARIABLE) if named else None


def set_up(process: str) -> logging.Logger:
    """Return the logger of `process`, writing ``process: LEVEL message`` to stderr; usually from info on."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter(f"{process}: %(levelname)s %(message)s"))
    logger = logging.getLogger(f"trocar.{process}")
    logger.setLevel(asked_level() or logging.INFO)
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
