"""Errors about recordings."""

from __future__ import annotations

from trocar.services.messages.exit_codes import ExitCode
from trocar.services.runtime.errors import UserError


class RecordingError(UserError):
    """A recording cannot be written or read."""

    exit_code: int = ExitCode.RECORDING
    is_told = True  # raised in a reader, the sentence goes to who asked as it is


class UnopenedError(RecordingError):
    """A recording is not there, or this user may not open it: as with any other file that was named."""

    exit_code = ExitCode.USAGE


class HoleError(RecordingError):
    """A part in the middle of a recording cannot be read."""

    exit_code = ExitCode.HOLE
