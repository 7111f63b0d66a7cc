"""Where the cache is: by which variable, and what happens where nothing can be kept there."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.other_user import needs_other_user

ROOT = Path(__file__).parents[2]
_SAY = "from trocar.services.files.cache_directory import *; print(p := cache_directory()); make_folders(p)"


def _asked(environment: Mapping[str, object], command: tuple[str, ...] = ()) -> subprocess.CompletedProcess[str]:
    """Ask a fresh process that has nothing but an environment of its own."""
    given = {"PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    words = [*command, sys.executable, "-c", _SAY]
    return subprocess.run(
        words, env={**given, **{key: str(value) for key, value in environment.items()}}, capture_output=True, text=True,
        check=False, cwd="/",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("variables", "place"),
    [
        ({"HOME": "{}", "XDG_CACHE_HOME": "{}/xdg", "TROCAR_CACHE_DIR": "{}/own"}, "own"),
        ({"HOME": "{}", "XDG_CACHE_HOME": "{}/xdg"}, "xdg/trocar"),
        ({"HOME": "{}", "XDG_CACHE_HOME": "relative"}, ".cache/trocar"),
        ({"HOME": "{}", "XDG_CACHE_HOME": ""}, ".cache/trocar"),
        ({"HOME": "{}"}, ".cache/trocar"),
    ],
)
def test_the_cache_is_where_the_first_variable_says(tmp_path: Path, variables: dict[str, str], place: str) -> None:
    ran = _asked({key: value.format(tmp_path) for key, value in variables.items()})
    assert (ran.stdout, ran.stderr) == (f"{tmp_path / place}\n", "")


@needs_other_user
@pytest.mark.parametrize("variable", ["HOME", "XDG_CACHE_HOME", "TROCAR_CACHE_DIR", ""])
@pytest.mark.parametrize("how", ["cannot be made", "below a file", "is closed"])
def test_where_nothing_can_be_kept_a_fresh_folder_is_used_and_a_line_says_why(
    tmp_path: Path, variable: str, how: str
) -> None:
    """A user of a container or a service has no home; an import, and so every verb, ended with a traceback."""
    tmp_path.chmod(0o755)
    closed = tmp_path / "closed"
    for folder in (closed, closed / ".cache", closed / ".cache" / "trocar", closed / "trocar"):
        folder.mkdir(mode=0o755)
    (tmp_path / "file").touch()
    where = {"cannot be made": "/nonexistent/home", "below a file": tmp_path / "file" / "a", "is closed": closed}[how]
    other = ("setpriv", "--reuid", "65533", "--regid", "65533", "--clear-groups")
    ran = _asked({variable: where} if variable else {}, other)
    assert ran.returncode == 0, ran.stderr
    assert " is not used: " in ran.stderr
    assert len(ran.stderr.splitlines()) == 1
    assert ran.stdout.startswith("/tmp/trocar-cache-")
    assert not Path(ran.stdout.strip()).exists(), "it is removed in the end"
