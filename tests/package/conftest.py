"""The wheel, built once from a copy of the tree: what is built leaves nothing in the tree itself."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
_PARTS = ("protocol", "services", "studies", "review", "trocar", "configs")
_FILES = ("pyproject.toml", "setup.py", "README.md", "LICENSE")


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the wheel of this tree, without kernels; its page is the one that `./dev` has built."""
    return _build(tmp_path_factory.mktemp("tree"))


@pytest.fixture(scope="session")
def wheel_with_kernels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the wheel of this tree with all kernels, which are compiled in some minutes unless they are there."""
    subprocess.run([sys.executable, "deploy/ship_kernels.py", "build/kernels"], cwd=ROOT, check=True)
    tree = tmp_path_factory.mktemp("tree")
    shutil.copytree(ROOT / "build" / "kernels", tree / "build" / "kernels")
    return _build(tree)


def _build(tree: Path) -> Path:
    for name in _PARTS:
        left_out = shutil.ignore_patterns("__pycache__", "node_modules")
        shutil.copytree(ROOT / name, tree / name, symlinks=True, ignore=left_out)
    for name in _FILES:
        shutil.copy2(ROOT / name, tree / name)
    options = ["--no-build-isolation", "--no-deps", "--no-cache-dir", "--quiet", "--wheel-dir", str(tree / "out")]
    done = subprocess.run(
        [sys.executable, "-m", "pip", "wheel", *options, str(tree)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (made,) = (tree / "out").glob("*.whl")
    return made
