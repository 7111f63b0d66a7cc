"""What all tests share: a cache of their own, and nothing of the caller's environment."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import services.runtime  # noqa: F401  first of all: it keeps the numerics libraries to one thread
from services import kernel_cache


@pytest.fixture(autouse=True, scope="session")
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Bases are built anew in every test run; rig options of the shell that started it do not reach the tests.

    Kernels stay where they are: their folder is named after their source, and a rig finds what the tests compiled.
    """
    directory = _shared(tmp_path_factory) / "cache"
    directory.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NUMBA_CACHE_DIR", str(kernel_cache.root()))
        patch.setenv("TROCAR_CACHE_DIR", str(directory))
        for name in ("TROCAR_RIG", "TROCAR_SCENE", "TROCAR_SET", "TROCAR_CONFIG_DIR"):
            patch.delenv(name, raising=False)
        yield directory


def _shared(factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the whole run, also where it has several workers: what one has built the other finds."""
    own = factory.getbasetemp()
    return own.parent if own.name.startswith("popen-") else own
