"""What a person can mend, said in one sentence with an exit code; all else is a fault of ours and a traceback."""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Callable
from io import TextIOWrapper

from trocar.services.runtime.errors import ConfigError, UserError

#: What the system refuses because of a path, a right or a disk.
_OF_A_PERSON = (
    errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EROFS, errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR,
    errno.EISDIR,
)  # fmt: skip


def run(command: Callable[[], object]) -> None:
    """Run a command on the arguments of this process; leaves with an exit code where it is refused."""
    _write_any_name()
    try:
        _refuse_empty(sys.argv[1:])
        command()
    except UserError as error:
        print(f"trocar: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] == "trocar":
            raise
        print(
            f"trocar: the package {error.name} is not installed; `trocar doctor` says what brings it", file=sys.stderr
        )
        sys.exit(1)
    except BrokenPipeError:  # `trocar sniff | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        if error.errno == errno.ENOENT and not _is_anywhere():
            print("trocar: the present folder is gone; `cd` to one that is there", file=sys.stderr)
            sys.exit(1)
        if error.errno not in _OF_A_PERSON:
            raise
        print(f"trocar: {error.filename or 'a file could not be written'}: {error.strerror}", file=sys.stderr)
        sys.exit(1)


def _write_any_name() -> None:
    """Make a name with characters that the terminal's encoding lacks readable there, and no error."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # not where nothing is open, or a test listens
            stream.reconfigure(errors="backslashreplace")


def _is_anywhere() -> bool:
    try:
        os.getcwd()
    except FileNotFoundError:
        return False
    return True


def _refuse_empty(arguments: list[str]) -> None:
    """Refuse what a variable of the shell that is not set leaves: as a path it would be the present folder."""
    for before, argument in zip(["", *arguments], arguments, strict=False):
        if not argument or re.fullmatch(r"--[a-z-]+=", argument):
            where = argument or (before if before.startswith("--") else "an argument")
            raise ConfigError(f"{where} is empty; the present folder is called '.'")
