"""Whatever a script of the repository installs comes from a lock file, or is named with its version."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_SCRIPTS = ("dev", "deploy/Dockerfile", "deploy/try-pythons", ".ci/run")
_OPTIONS_WITH_VALUES = {"-r", "-c", "--wheel-dir", "--python", "--find-links"}


def _installed(text: str) -> list[str]:
    """Return what the calls of `pip install` name, without options and lock files."""
    named = []
    for call in re.findall(r"pip install([^&|;\n]*)", text.replace("\\\n", " ")):
        words = call.split()
        for before, word in zip(["", *words], words, strict=False):
            if not word.startswith("-") and before not in _OPTIONS_WITH_VALUES and word not in (".", "`"):
                named.append(word.strip("\"'`)"))
    return named


def test_no_script_installs_whatever_is_the_newest() -> None:
    """`./dev lock` took any `uv`, which then wrote the lock files."""
    for script in _SCRIPTS:
        path = ROOT / script
        for name in _installed(path.read_text("utf-8")) if path.is_file() else []:
            assert "==" in name or name in ("$uv", ".") or name.endswith((".whl", "[all]")), f"{script}: {name}"


def test_the_tool_that_writes_the_lock_files_has_a_version_that_dev_reads() -> None:
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["dependency-groups"]
    (uv,) = groups["lock"]
    assert re.fullmatch(r"uv==\d+(\.\d+)+", uv)
    assert f'\nlock = ["{uv}"]\n' in (ROOT / "pyproject.toml").read_text("utf-8"), "as ./dev looks for it"
