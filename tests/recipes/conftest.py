"""A copy of the tree for each test that follows a recipe."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.recipes.tree_copy import TreeCopy


@pytest.fixture
def tree(tmp_path: Path) -> TreeCopy:
    """Return a fresh copy: what a recipe does there, nobody else sees."""
    return TreeCopy(tmp_path / "tree")
