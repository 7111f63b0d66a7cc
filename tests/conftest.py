"""What all tests share: a cache of their own, and nothing of the caller's environment.

Bases, blocks and what walls have learned take a minute to compute, so they are kept from run to run, as kernels are. An
entry of the cache is named by the content that it follows from and by part of the code; here a folder is named by all
source that makes entries, and by the libraries' versions, so that changed code never meets what other code has made.

Tests marked ``long`` run with ``--long`` only.
"""

from __future__ import annotations

import contextlib
import gc
import hashlib
import os
import shutil
import sys
import time
from collections.abc import Callable, Generator, Iterator
from functools import partial
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import settings

import trocar.services.start.entry  # noqa: F401  first of all: kernels and threads as in a process of the rig
from tests import file_seconds
from tests.by_day import LONG
from trocar.services.files.cache_directory import cache_directory
from trocar.services.kernels import kernel_cache
from trocar.services.kernels.source_closure import Sources

#: The modules that make entries of the cache: their results follow from these and from what they import.
MAKERS = (
    "trocar.services.mechanics.reduction.nonlinear.quadratic_manifold",
    "trocar.services.mechanics.reduction.reduce",
    "trocar.services.mechanics.reduction.softening.training",
    "trocar.services.mechanics.reduction.hyperelastic.energy_sampling",
    "trocar.services.mechanics.simulation.traction",
    "trocar.services.meshes.branching",
    "trocar.services.meshes.cached",
)
_LIBRARIES = ("numpy", "scipy", "numba", "trimesh", "pyvista", "pyacvd")
_KEPT = 3
_IN_USE_S = 3600.0


# Properties are tried with other numbers in every run; what fails prints how it is run again.
settings.register_profile("trocar", deadline=None, print_blob=True)
settings.register_profile(LONG, settings.get_profile("trocar"), max_examples=1000)
settings.load_profile("trocar")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--long", action="store_true", help="also run what is marked long: before a release")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--long"):
        settings.load_profile(LONG)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Where only rigs are run, files that start none are not imported: all of them together take a while."""
    if config.option.markexpr != "rig" or not collection_path.match("test_*.py"):
        return None
    return "mark.rig" not in collection_path.read_text(encoding="utf-8") or None


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Look for no garbage while all files are imported, nor later in what they have made: it lives to the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Take away the garbage of a file. What is left, as its kernels, lives to the end and is looked through no more.

    What garbage says, as that it was never closed, fails the next test that is run: so it names the file.
    """
    if nextitem is not None and nextitem.path != item.path:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "unraisablehook", partial(_tell_of_garbage, sys.unraisablehook, item.path.name))
            gc.collect()
        gc.freeze()


def _tell_of_garbage(tell: Callable[[Any], object], file: str, told: Any) -> None:
    """Tell who has left garbage that complains."""
    said = {name: getattr(told, name) for name in ("exc_type", "exc_value", "exc_traceback", "object")}
    tell(SimpleNamespace(**said, err_msg=f"{file} left this behind, {told.err_msg or 'an exception in'}"))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is long, unless it is asked for; in a run of all, files that took longest come first."""
    seconds = file_seconds.of_last_run() if file_seconds.COPY in os.environ else {}
    items.sort(key=lambda item: -seconds.get(file_seconds.dotted_name(item.nodeid), 0.0))
    if config.getoption("--long"):
        return
    left_out = [item for item in items if item.get_closest_marker("long")]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]


@pytest.fixture(autouse=True)
def same_environment() -> Iterator[None]:
    """A command that is called in the test's own process sets variables: the next test must not inherit them."""
    before = dict(os.environ)
    yield
    for name in os.environ.keys() - before.keys():
        del os.environ[name]
    os.environ.update(before)


@pytest.fixture
def private_folder(tmp_path: Path) -> Path:
    """Return a folder that is this user's alone, as those of rigs must be."""
    tmp_path.chmod(0o700)
    return tmp_path


@pytest.fixture(autouse=True, scope="session")
def own_cache() -> Iterator[Path]:
    """Rig options of the shell that started the tests do not reach them, nor the user's own bases.

    Kernels stay where they are: their folder is named after their source, and a rig finds what the tests compiled.
    """
    of_user = cache_directory()
    # Tests of a recipe's copy are run by a test: their folder is beside its own.
    directory = kept_directory(of_user.parent if of_user.parent.name == "tests" else of_user / "tests")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NUMBA_CACHE_DIR", str(kernel_cache.root()))
        patch.setenv("TROCAR_CACHE_DIR", str(directory))
        for name in ("TROCAR_RIG", "TROCAR_SCENE", "TROCAR_SET", "TROCAR_CONFIG_DIR"):
            patch.delenv(name, raising=False)
        yield directory


def kept_directory(root: Path) -> Path:
    """Return the folder below ``root`` of the code as it is now; of those of other code the last used few are kept."""
    sources = Sources(Path(__file__).parents[1])
    made_of = [sources.digest(module) for module in MAKERS] + [version(name) for name in _LIBRARIES]
    directory = root / hashlib.sha256("\n".join(made_of).encode()).hexdigest()[:16]
    directory.mkdir(parents=True, exist_ok=True)
    directory.touch()
    ages = sorted((time.time() - path.stat().st_mtime, path) for path in root.iterdir())
    for age_s, path in ages[_KEPT:]:
        if age_s > _IN_USE_S:
            with contextlib.suppress(OSError):
                shutil.rmtree(path)
    return directory
