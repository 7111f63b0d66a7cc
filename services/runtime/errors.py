"""Errors that a person caused or can fix: one sentence and an exit code, without traceback."""

from __future__ import annotations

from trocar.services.messages.exit_codes import ExitCode
from trocar.services.messages.extras import how_to_get


class UserError(Exception):
    """An error for the person at the rig: one sentence that names the file, the key or the place."""

    exit_code: int = ExitCode.FAILURE


class ConfigError(UserError):
    """What was asked for cannot be: an invalid option or configuration, or a file that cannot be opened."""

    exit_code = ExitCode.USAGE


class BusError(UserError):
    """An unavailable endpoint: used by another process, or with an invalid path."""

    exit_code = ExitCode.BUS


class DeviceError(UserError):
    """A device or its library is missing, or fails."""

    exit_code = ExitCode.LACKING


class MissingPackageError(UserError):
    """A Python package is not installed that what was asked for needs.

    Args:
        what: What needs it: the beginning of the sentence.
        package: Name by which it is imported.
    """

    exit_code = ExitCode.LACKING

    def __init__(self, what: str, package: str | None) -> None:
        super().__init__(f"{what} needs the package {package!r}: {how_to_get(package)}")


class EndOfRig(UserError):  # noqa: N818 - nothing went wrong
    """A person has ended the rig by closing a process' window; the supervisor ends the other processes."""

    exit_code = ExitCode.ENDED_BY_PERSON
