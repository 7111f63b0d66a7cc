"""Errors about recordings."""

from __future__ import annotations

from trocar.services.runtime.errors import UserError


class RecordingError(UserError):
    """A recording cannot be written or read."""

    exit_code = 5


class HoleError(RecordingError):
    """A part in the middle of a recording cannot be read."""

    exit_code = 7
