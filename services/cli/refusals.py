"""Errors that a person can mend end in one sentence and an exit code; any other, a fault of ours, in a traceback."""

from __future__ import annotations

import errno
import os
import re
import sys
from io import TextIOWrapper

import typer

from trocar.services.messages.exit_codes import ExitCode
from trocar.services.runtime.errors import ConfigError, MissingPackageError, UserError
from trocar.services.start import interrupts

#: What the system refuses because of a path, a right or a disk.
_OF_A_PERSON = (
    errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EROFS, errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR,
    errno.EISDIR,
)  # fmt: skip


def run(app: typer.Typer) -> None:
    """Run a command on the arguments of this process; leaves with an exit code where it is refused."""
    try:
        with interrupts.Raised():
            _write_any_name()
            _refuse_empty(sys.argv[1:])
            ended = app(standalone_mode=False, prog_name="trocar")
    except UserError as error:
        _leave(str(error), error.exit_code)
    except typer.TyperException as error:
        _leave(usage_sentence(error), error.exit_code)
    except (typer.Abort, KeyboardInterrupt):
        interrupts.end()
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] == "trocar":
            raise
        missing = MissingPackageError("this", error.name)
        _leave(str(missing), missing.exit_code)
    except BrokenPipeError:  # `trocar diagnose sniff | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(ExitCode.FAILURE)
    except OSError as error:
        _refuse_for_system(error)
    else:
        if ended == ExitCode.INTERRUPTED:
            interrupts.end()
        if isinstance(ended, int) and ended:  # of `typer.Exit`
            sys.exit(ended)


def usage_sentence(error: typer.TyperException) -> str:
    """Return what is wrong with the words of a command, as one sentence that names its help; empty if that was shown.

    The library's own display is a box of several lines around two sentences.
    """
    said = " ".join(error.format_message().replace("Value error, ", "").split()).rstrip(".?")
    said = said.replace(". Did you mean", "; did you mean").replace(" (Possible", " (possible")
    context = getattr(error, "ctx", None)
    verb = context.command_path if context is not None else "trocar"
    return f"{said[0].lower()}{said[1:]}; see `{verb} --help`" if said else ""


def _leave(sentence: str, code: int) -> None:
    if sentence:
        print(f"trocar: {sentence}", file=sys.stderr)
    sys.exit(code)


def _refuse_for_system(error: OSError) -> None:
    """Say what the system refuses: of a file that the person named it is the words that are wrong."""
    if error.errno == errno.ENOENT and not _is_anywhere():
        _leave("the present folder is gone; `cd` to one that is there", ExitCode.USAGE)
    named = bool(error.filename) and any(os.fspath(error.filename) in each for each in sys.argv[1:])
    if error.errno not in _OF_A_PERSON and not (named and error.errno == errno.ENOENT):
        raise error
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    why = (error.strerror or str(error)).lower()
    _leave(f"{error.filename or 'a file could not be written'}: {why}", ExitCode.FAILURE if full else ExitCode.USAGE)


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
