"""Whether others can put something of theirs in the place of a file: by owner and mode of all that leads to it."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

_SHARED = stat.S_IWGRP | stat.S_IWOTH


def fault_of_place(path: Path, its_own: bool = True, below: Path | None = None) -> str:
    """Return why others can change what lies at `path` or replace it, empty where only this user and root can.

    Every folder and link on the way counts; what is not there yet is made by this user. Without `its_own` the last
    step is left to the caller, as is the way down to `below`. In a folder such as ``/tmp`` (sticky) nobody replaces
    what is another's.
    """
    last = Path(os.path.abspath(path))
    top = Path(os.path.abspath(below)) if below is not None else None
    known = {top, *top.parents} if top is not None else set()
    try:
        for step in _steps(last):
            if step not in known and (fault := _fault(step, step == last, its_own)):
                return fault
    except FileNotFoundError:
        return ""
    except OSError as error:
        return f"{error.filename}: {(error.strerror or str(error)).lower()}"
    return ""


def _steps(path: Path) -> Iterator[Path]:
    """Yield the folders from the root to `path`, and after each link those that lead to what it stands for."""
    for step in (*reversed(path.parents), path):
        yield step
        if step.is_symlink():
            step.stat()  # a ring of links ends here
            yield from _steps(step.parent / step.readlink())


def _fault(step: Path, is_last: bool, its_own: bool) -> str:
    found = step.lstat()
    if is_last and not its_own:
        return ""
    # In a user namespace root may have no number of its own: the owner of ``/`` stands for it.
    if found.st_uid not in (0, os.geteuid()) and (is_last or found.st_uid != os.stat("/").st_uid):
        return f"{step} belongs to user {found.st_uid}"
    kept_apart = not is_last and found.st_mode & stat.S_ISVTX
    if stat.S_ISLNK(found.st_mode) or kept_apart or not found.st_mode & _SHARED:
        return ""
    if not found.st_mode & stat.S_IWOTH and found.st_gid in (0, os.getegid()) and _is_alone_in(found.st_gid):
        return ""
    return f"others may write to {step} (mode {stat.S_IMODE(found.st_mode):04o})"


def _is_alone_in(group: int) -> bool:
    """Whether a group is root's or has no members but the user of its name, as Debian makes one for each user."""
    import grp
    import pwd

    try:
        name = pwd.getpwuid(os.geteuid()).pw_name
        found = grp.getgrgid(group)
    except KeyError:
        return False
    return group == 0 or (found.gr_name == name and set(found.gr_mem) <= {name})
