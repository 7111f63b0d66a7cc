"""Each version of the source compiles its own kernels."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from services import kernel_cache

ROOT = Path(kernel_cache.__file__).parent


def _copy(folder: Path) -> Path:
    """Copy what decides, with this module beside it, and return the folder of the copy."""
    for name in ("mechanics", "gateway"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def test_a_change_in_any_kernel_is_another_folder(tmp_path: Path) -> None:
    copy = _copy(tmp_path / "services")
    before = kernel_cache._digest(copy)
    assert kernel_cache._digest(copy) == before
    source = next((copy / "mechanics" / "rod").glob("*.py"))
    source.write_text(source.read_text() + "\n")
    assert kernel_cache._digest(copy) != before


def test_children_share_the_folder_and_do_not_nest_it(tmp_path: Path) -> None:
    code = "import os, services; print(os.environ['NUMBA_CACHE_DIR'])"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    outputs = []
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        outputs.append(done.stdout.strip())
        environment["NUMBA_CACHE_DIR"] = outputs[-1]
    assert outputs[0] == outputs[1]
    assert Path(outputs[0]).parent == tmp_path


def test_the_newest_few_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for age in range(6):
        folder = tmp_path / f"source-{age}"
        folder.mkdir()
        os.utime(folder, (1_000_000 - age, 1_000_000 - age))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    chosen = kernel_cache.choose()
    assert chosen.parent == tmp_path
    assert sorted(p.name for p in tmp_path.iterdir()) == ["source-0", "source-1", "source-2"]
