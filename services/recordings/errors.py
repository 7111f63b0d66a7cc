"""What is said of a recording that cannot be used."""

from __future__ import annotations

from services.runtime.errors import UserError


class RecordingError(UserError):
    """A recording that cannot be written, or read."""

    exit_code = 5


class HoleError(RecordingError):
    """A recording of which a part in the middle cannot be read."""

    exit_code = 7
