"""Where recordings are kept: looked at before a rig starts, and by its recorder again."""

from __future__ import annotations

import os
from pathlib import Path

from trocar.services.files.trusted_path import fault_of_place


def fault_of_folder(folder: Path, *, shared: bool) -> str:
    """Return why no recording can be kept in `folder`, which is made where it is missing; empty where one can.

    Args:
        folder: Of the recordings.
        shared: Whether it is accepted that others can replace them.
    """
    nearest = nearest_there(folder)
    if not nearest.is_dir():
        return f"{nearest} is a file, not a folder"
    if not os.access(nearest, os.W_OK | os.X_OK):
        return f"this user may not write to {nearest}"
    fault = "" if shared else fault_of_place(folder / "any", its_own=False)
    return fault and f"{fault}; recorder.shared: true accepts that"


def nearest_there(path: Path) -> Path:
    """Return `path`, or of the folders above it the first that is there."""
    return next(each for each in (path.absolute(), *path.absolute().parents) if os.path.lexists(each))
