"""A compiled kernel is found again exactly where all source that it was made of is the same."""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.kernels.kernel_checkout import CALLEE, make_checkout
from tests.kernels.preloaded import Preloaded, Running
from trocar.services.kernels import kernel_cache
from trocar.services.kernels.source_closure import Sources

pytestmark = pytest.mark.timeout(600)  # it waits for processes that compile

ASK = "from trocar.services.caller import outer; print(outer({}), sum(outer.stats.cache_misses.values()))"
NUMBA = "import numba; numba.njit(lambda x: x + 1)(1)"
SLOW_INDEX = """
import time
from numba.core.caching import IndexDataCacheFile
save = IndexDataCacheFile._save_index
def slow(self, overloads):
    time.sleep(0.4)
    save(self, overloads)
    time.sleep(0.4)
IndexDataCacheFile._save_index = slow
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    return make_checkout(tmp_path / "checkout")


@pytest.fixture(autouse=True, scope="module")
def numba(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Preloaded]:
    """All that is asked is asked of processes that have numba, and have compiled something, but nothing of ours."""
    global _numba
    with Preloaded(tmp_path_factory.mktemp("numba"), NUMBA) as _numba:
        yield _numba


_numba: Preloaded


def _start(tree: Path, argument: str, before: str = "", **variables: str) -> Running:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_CACHE_")}
    environment |= {"NUMBA_CACHE_DIR": str(tree.parent / "kernels"), **variables}
    return _numba.start(before + ASK.format(argument), (), tree, environment)


def _run(tree: Path, argument: str = "1", **variables: str) -> tuple[float, int]:
    """Return what the kernel says and how often it had to be compiled."""
    return _answer(_start(tree, argument, **variables))


def _answer(process: Running) -> tuple[float, int]:
    done = process.wait()
    assert done.returncode == 0, done.stderr
    value, misses = done.stdout.split()
    return float(value), int(misses)


def _edit(file: Path, text: str) -> None:
    """Write a file seconds after it was written: Python takes bytecode for a source of the same second and length."""
    later_s = file.stat().st_mtime + 2.0
    file.write_text(text)
    os.utime(file, (later_s, later_s))


def test_a_process_that_imports_numba_after_us_finds_the_same(tree: Path) -> None:
    """As every process of a rig does; the others here had numba before."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_CACHE_")}
    environment |= {"PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(tree.parent / "kernels")}
    command = [sys.executable, "-c", ASK.format("1")]
    asked = [subprocess.run(command, env=environment, cwd=tree, capture_output=True, text=True) for _ in range(2)]
    assert [each.stdout for each in asked] == ["20 1\n", "20 0\n"]
    assert _run(tree) == (20, 0)


def test_an_edit_of_a_callee_compiles_its_callers_and_an_edit_elsewhere_does_not(tree: Path) -> None:
    assert _run(tree) == (20, 1)
    assert _run(tree) == (20, 0)
    (tree / "trocar" / "services" / "parts" / "stranger.py").write_text("X = 2\n")
    assert _run(tree) == (20, 0)
    _edit(tree / "trocar" / "services" / "parts" / "callee.py", CALLEE.replace("x + 1", "x + 2"))
    assert _run(tree) == (30, 1)
    _edit(tree / "trocar" / "services" / "parts" / "callee.py", CALLEE)
    assert _run(tree) == (20, 0), "what was there before is still there"


def test_a_copy_of_the_tree_compiles_nothing_and_other_options_do(tree: Path) -> None:
    assert _run(tree) == (20, 1)
    copy = tree.parent / "elsewhere" / "copy"
    shutil.copytree(tree, copy, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.rmtree(tree)
    variables = {"NUMBA_CACHE_DIR": str(tree.parent / "kernels")}
    assert _run(copy, **variables) == (20, 0)
    assert _run(copy, NUMBA_BOUNDSCHECK="1", **variables) == (20, 1)


def test_two_processes_that_compile_two_signatures_at_once_keep_both(tree: Path) -> None:
    both = [_start(tree, argument, SLOW_INDEX) for argument in ("1", "1.5")]
    assert [_answer(process) for process in both] == [(20, 1), (25, 1)]
    assert _run(tree, "1") == (20, 0)
    assert _run(tree, "1.5") == (25, 0)


def test_a_folder_that_cannot_be_written_is_left_to_numba(tree: Path) -> None:
    (tree.parent / "kernels").touch()
    assert _run(tree, NUMBA_CACHE_DIR=str(tree.parent / "kernels" / "below"), XDG_CACHE_HOME=str(tree)) == (20, 1)


def test_a_flipped_bit_and_a_foreign_pickle_are_neither_run_nor_read(tree: Path) -> None:
    assert _run(tree) == (20, 1)
    for kind in ("nbi", "nbc"):
        (stored,) = (tree.parent / "kernels").glob(f"trocar.services.caller-*/*.{kind}")
        whole = stored.read_bytes()
        stored.write_bytes(whole[:-40] + bytes([whole[-40] ^ 1]) + whole[-39:])
        assert _run(tree) == (20, 1), "compiled anew"
        assert _run(tree) == (20, 0), "and found again"
        stored.write_bytes(pickle.dumps(_Foreign()))
        assert _run(tree) == (20, 1)


class _Foreign:
    def __reduce__(self) -> tuple[object, ...]:
        return print, ("foreign code runs",)


@pytest.mark.parametrize("name", ["kernels", ""])
def test_a_cache_that_others_may_write_to_is_not_read(tree: Path, name: str) -> None:
    cache = tree.parent / "shared"
    variables = {"TROCAR_CACHE_DIR": str(cache), "NUMBA_CACHE_DIR": "" if not name else str(cache / "kernels")}
    assert _run(tree, **variables) == (20, 1)
    assert _run(tree, **variables) == (20, 0)
    cache.chmod(0o777)
    assert _run(tree, **variables) == (20, 1)
    cache.chmod(0o700)
    assert _run(tree, **variables) == (20, 0)


def test_every_way_to_import_is_followed(tmp_path: Path) -> None:
    package = tmp_path / "trocar" / "a"
    package.mkdir(parents=True)
    (tmp_path / "trocar" / "__init__.py").touch()
    (package / "__init__.py").write_text("from trocar.a.far import X\n")
    for name in ("far", "near", "lazy", "plain", "strange"):
        (package / f"{name}.py").write_text("X = 1\n")
    (package / "user.py").write_text(
        "import numpy as np\nimport trocar.a.plain as p\nfrom . import near\nfrom trocar.a import X\n"
        "def f():\n    from .lazy import X\n"
    )
    closure = Sources(tmp_path).closure("trocar.a.user")
    assert closure == {f"trocar.a.{name}" for name in ("user", "near", "lazy", "plain", "far")} | {"trocar.a"}


def test_what_was_not_used_for_longest_is_forgotten_but_nothing_in_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    module = "trocar.services.mechanics.example"
    for age in range(20):
        folder = tmp_path / f"{module}-{age:02}"
        folder.mkdir()
        os.utime(folder, (1_000_000 - age, 1_000_000 - age))
    (tmp_path / "trocar.services.mechanics.other-1").mkdir()
    os.utime(tmp_path / "trocar.services.mechanics.other-1", (0, 0))
    os.utime(tmp_path / f"{module}-19")
    locator = kernel_cache.Locator(tmp_path / f"{module}-new", 1)
    locator.ensure_cache_path()
    kernel_cache.settle()
    kept = sorted(path.name.rpartition("-")[2] for path in tmp_path.glob(f"{module}-*"))
    assert kept == ["00", "01", "02", "03", "04", "05", "19", "new"]
    assert (tmp_path / "trocar.services.mechanics.other-1").is_dir()


def test_a_folder_that_another_process_forgets_meanwhile_is_no_fault(tmp_path: Path) -> None:
    gone = tmp_path / "trocar.services.mechanics.example-gone"
    gone.symlink_to(tmp_path / "removed")  # is listed, and is not there when it is looked at
    kernel_cache._forget_oldest(tmp_path / "trocar.services.mechanics.example-new")
    assert gone.is_symlink()
