"""Bytecode of ours is kept in the cache where Python may keep none beside the source, and is that of the source."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from trocar import services

_SHOW = """
import trocar.services.start.entry
import trocar.services.runtime.measures.histogram as ours, trocar.protocol.frame, sys, json.decoder
print(sys.dont_write_bytecode, sys.pycache_prefix, ours.PER_OCTAVE)
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Return a folder in which `trocar` is installed, with no links in it."""
    installed, ours = tmp_path / "tree" / "trocar", Path(services.__file__).parents[1]
    for name in ("services", "protocol"):
        shutil.copytree(ours / name, installed / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy2(ours / "__init__.py", installed)
    return tmp_path / "tree"


def _run(tree: Path, cache: Path, **environment: str) -> str:
    settings = {**os.environ, "PYTHONPATH": str(tree), "TROCAR_CACHE_DIR": str(cache), "PYTHONPYCACHEPREFIX": ""}
    settings |= environment
    done = subprocess.run(
        [sys.executable, "-c", _SHOW], capture_output=True, text=True, env=settings, check=True, cwd=tree
    )
    return done.stdout.strip()


def test_it_is_kept_in_the_cache_and_follows_the_source(tree: Path, tmp_path: Path) -> None:
    cache, forbidden = tmp_path / "cache", {"PYTHONDONTWRITEBYTECODE": "1"}
    assert _run(tree, cache, **forbidden) == "True None 16"
    kept = [path.name for path in cache.rglob("*.pyc")]
    assert any(name.startswith("histogram.") for name in kept)
    assert any(name.startswith("frame.") for name in kept)
    assert not any(name.startswith("decoder.") for name in kept), "what others wrote stays as it was"
    assert not list(tree.rglob("*.pyc"))
    source = tree / "trocar" / "services" / "runtime" / "measures" / "histogram.py"
    source.write_text(source.read_text().replace("PER_OCTAVE = 16", "PER_OCTAVE = 32 "))
    assert _run(tree, cache, **forbidden) == "True None 32"


def test_where_python_keeps_it_beside_the_source_nothing_is_changed(tree: Path, tmp_path: Path) -> None:
    assert _run(tree, tmp_path / "cache", PYTHONDONTWRITEBYTECODE="") == "False None 16"
    assert not list((tmp_path / "cache").rglob("*.pyc"))
    assert list(tree.rglob("histogram.*.pyc"))


def test_what_an_image_has_beside_the_source_is_taken_until_the_source_is_newer(tree: Path, tmp_path: Path) -> None:
    cache, forbidden = tmp_path / "cache", {"PYTHONDONTWRITEBYTECODE": "1"}
    beside = os.environ | {"PYTHONPYCACHEPREFIX": ""}
    subprocess.run([sys.executable, "-m", "compileall", "-q", tree], check=True, env=beside)
    assert _run(tree, cache, **forbidden) == "True None 16"
    assert not list(cache.rglob("*.pyc"))
    source = tree / "trocar" / "services" / "runtime" / "measures" / "histogram.py"
    source.write_text(source.read_text().replace("PER_OCTAVE = 16", "PER_OCTAVE = 32 "))
    os.utime(source, (2e9, 2e9))
    assert _run(tree, cache, **forbidden) == "True None 32"
    assert [path.name.partition(".")[0] for path in cache.rglob("*.pyc")] == ["histogram"]


@pytest.mark.parametrize("inner", [False, True])
def test_where_others_could_have_put_bytecode_it_is_compiled_anew(tree: Path, tmp_path: Path, inner: bool) -> None:
    tmp_path.chmod(0o700)
    cache = tmp_path / "cache"
    made = _run(tree, cache, PYTHONDONTWRITEBYTECODE="1")
    (kept,) = cache.rglob("histogram.*.pyc")
    written = kept.read_bytes()
    kept.write_bytes(written.replace(b"PER_OCTAVE", b"RER_OCTAVE"))
    (kept.parent if inner else cache / "bytecode").chmod(0o777)
    assert _run(tree, cache, PYTHONDONTWRITEBYTECODE="1") == made
    assert kept.read_bytes() == written
    assert not list(cache.glob("**/.[!.]*")), "what was removed is gone"


def test_folders_of_bytecode_are_private_whatever_the_umask(tree: Path, tmp_path: Path) -> None:
    cache, before = tmp_path / "above" / "cache", os.umask(0)
    try:
        _run(tree, cache, PYTHONDONTWRITEBYTECODE="1")
    finally:
        os.umask(before)
    folders = [path for path in (cache.parent, *cache.parent.rglob("*")) if path.is_dir()]
    assert len(folders) > 5
    assert {oct(path.stat().st_mode & 0o777) for path in folders} == {"0o700"}
