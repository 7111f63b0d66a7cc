"""One copy of the tree for all of a worker's tests that follow a recipe: each begins with it as new."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.kernels.preloaded import Preloaded
from tests.recipes.tree_copy import LIBRARIES, TreeCopy


@pytest.fixture(scope="session")
def only_copy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TreeCopy]:
    """Return the copy as whoever had it last has left it."""
    folder = tmp_path_factory.mktemp("recipes")
    with Preloaded(folder, LIBRARIES) as forks:
        yield TreeCopy(folder / "tree", forks)


@pytest.fixture
def tree(only_copy: TreeCopy) -> TreeCopy:
    """Return the copy as new, for one test."""
    only_copy.restore()
    return only_copy


@pytest.fixture(scope="module")
def tree_of_module(only_copy: TreeCopy) -> TreeCopy:
    """Return the copy as new, for all tests of a module, none of which asks for `tree`."""
    only_copy.restore()
    return only_copy
