"""Checks the place of a verb's results before the verb begins; one sentence says if nothing can be written there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trocar.services.files.atomic_file import atomic_file
from trocar.services.runtime.errors import ConfigError, UserError


def look_at_file(option: str, path: Path | None, *, makes_folder: bool = False) -> None:
    """Refuse a file that could not be written in the end; with `makes_folder`, its folder is made.

    Raises ConfigError naming the option: the path is a folder, its folder is not there, or one of them is closed to
    this user.
    """
    if path is None:
        return
    folder = path.absolute().parent
    if makes_folder and not folder.is_dir():
        make_folder(option, folder)
    if not folder.is_dir():
        raise ConfigError(f"{option} {path}: there is no folder {folder}")
    if path.is_dir():
        raise ConfigError(f"{option} {path}: is a folder, not a file")
    closed = path if path.exists() else folder
    if not os.access(closed, os.W_OK):
        raise ConfigError(f"{option} {path}: this user may not write {closed}")


def make_folder(option: str, path: Path) -> None:
    """Make a folder for results, with those above it, unless it is there.

    Raises ConfigError naming the option: a file is in its place, or it cannot be made or written to.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise ConfigError(f"{option} {path}: is a file, not a folder") from None
    except OSError as error:
        raise ConfigError(f"{option} {path}: the folder cannot be made: {error.strerror}") from None
    if not os.access(path, os.W_OK):
        raise ConfigError(f"{option} {path}: this user may not write there")


def make_figures_folder(option: str, page: Path) -> Path:
    """Return the folder for the figures of a page, made beside it: it is called as the page without its ending.

    Raises ConfigError naming the option: the page has no ending, or one of both cannot be made or written to.
    """
    folder = page.absolute().with_suffix("")
    if folder == page.absolute() and not page.is_dir():
        raise ConfigError(f"{option} {page}: needs an ending, as .md: without it this is the folder of its figures")
    look_at_file(option, page, makes_folder=True)
    make_folder(option, folder)
    return folder


@contextmanager
def writing(option: str, path: Path) -> Iterator[None]:
    """Turn what the system refuses meanwhile (a full disk) into one sentence.

    Raises UserError naming the option and the reason.
    """
    try:
        yield
    except OSError as error:
        raise UserError(f"{option} {path}: cannot be written: {error.strerror or error}") from None


def write_text(option: str, path: Path, text: str) -> None:
    """Write a file so that a reader sees all of it or what was there before, as `atomic_file` says.

    Raises UserError naming the option and the reason.
    """
    with writing(option, path), atomic_file(path) as half:
        half.write_text(text, encoding="utf-8")
