"""After `./dev up` alone the tree has no pytest: `./dev shell` and `./dev pytest` bring what the recipes type."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
#: This interpreter, but it builds no page; and a pip that only writes down what it should install.
_PYTHON = f"""#!/bin/sh
[ "$2" = trocar.services.visualization.web.build ] || exec {sys.executable} "$@"
"""
_PIP = '#!/bin/sh\necho "$@" >> pip.log\n'


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Return a tree in which `./dev up` has been run."""
    for name in ("dev", "pyproject.toml", "requirements-run.lock", "requirements-dev.lock"):
        shutil.copy2(ROOT / name, tmp_path / name)
    tools = tmp_path / ".venv" / "bin"
    tools.mkdir(parents=True)
    for name, text in (("python", _PYTHON), ("pip", _PIP)):
        (tools / name).write_text(text)
        (tools / name).chmod(0o755)
    (tmp_path / "test_one.py").write_text("def test_one() -> None:\n    pass\n")
    return tmp_path


def _dev(tree: Path, *arguments: str) -> str:
    environment = {**os.environ, "SHELL": "/bin/sh"}
    ran = subprocess.run(
        [tree / "dev", *arguments], capture_output=True, text=True, cwd="/", env=environment, check=False
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    return ran.stdout


def test_pytest_of_the_tree_brings_what_it_needs(tree: Path) -> None:
    said = _dev(tree, "pytest", "-q", "-p", "no:cacheprovider", "test_one.py")
    assert "1 passed" in said
    assert "requirements-dev.lock" in (tree / "pip.log").read_text()


def test_a_shell_has_the_tools_of_the_tree(tree: Path) -> None:
    said = _dev(tree, "shell", "-c", "command -v python; echo $VIRTUAL_ENV; pwd").splitlines()
    assert said == [f"{tree}/.venv/bin/python", f"{tree}/.venv", str(tree)]
    assert "requirements-dev.lock" in (tree / "pip.log").read_text()
    (tree / "pip.log").unlink()
    _dev(tree, "shell", "-c", "true")
    assert not (tree / "pip.log").exists()
