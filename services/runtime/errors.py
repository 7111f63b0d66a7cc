"""Errors that a person caused or can fix: one sentence and an exit code, without traceback."""

from __future__ import annotations


class UserError(Exception):
    """An error for the person at the rig: one sentence that names the file, the key or the place."""

    exit_code = 1


class ConfigError(UserError):
    """An invalid configuration file or option."""

    exit_code = 2


class BusError(UserError):
    """An unavailable endpoint: used by another process, or with an invalid path."""

    exit_code = 3


class DeviceError(UserError):
    """A device or its library is missing."""

    exit_code = 4


class EndOfRig(UserError):  # noqa: N818 - nothing went wrong
    """A person has ended the rig by closing a process' window; the supervisor ends the other processes."""

    exit_code = 6
