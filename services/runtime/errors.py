"""Errors that a person caused or can mend: one sentence, an exit code, no traceback."""

from __future__ import annotations


class UserError(Exception):
    """Something to tell the person at the rig in one sentence that names the file, the key or the place."""

    exit_code = 1


class ConfigError(UserError):
    """A configuration file or option that cannot be used."""

    exit_code = 2


class BusError(UserError):
    """An endpoint that cannot be had: taken by another process, or a path that is not allowed."""

    exit_code = 3


class DeviceError(UserError):
    """A device, or the library that drives it, is not there."""

    exit_code = 4


class EndOfRig(UserError):  # noqa: N818 - nothing went wrong
    """A person has ended the rig at one of its processes, by closing its window: the supervisor ends the others."""

    exit_code = 6
