"""What all tests share: a cache of their own, and nothing of the caller's environment."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import services.runtime  # noqa: F401  first of all: it keeps the numerics libraries to one thread


@pytest.fixture(autouse=True, scope="session")
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Bases are built anew in every test run; rig options of the shell that started it do not reach the tests."""
    directory = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TROCAR_CACHE_DIR", str(directory))
        for name in ("TROCAR_RIG", "TROCAR_SCENE", "TROCAR_SET", "TROCAR_CONFIG_DIR"):
            patch.delenv(name, raising=False)
        yield directory
